//! Empty. iceoryx2 has `bindgen` among its build dependencies and calls it where the target is QNX, nowhere else: with this crate
//! in its place a build compiles a dozen crates less, and needs no libclang.
