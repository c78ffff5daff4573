//! Empty. iceoryx2 lists `bindgen` among its build dependencies and calls it only for the target QNX. With this crate in its
//! place a build compiles a dozen fewer crates and does not need libclang.
