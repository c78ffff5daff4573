//! How the processes of oqtal meet.
