//! Level sets in OpenVDB behind a safe interface.

mod ffi;
