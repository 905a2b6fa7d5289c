//! Memory of the process, including allocations of C++.
//!
//! Numbers come from the system's status of the process, and cover the trees of OpenVDB as well. Nothing here limits
//! memory.

/// What the system refuses to a program.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Exhausted {
    Memory,
    Threads,
}

/// Ends the process once memory or threads run out, in Rust or C++, with `words` on stderr, `json` on stdout and an
/// exit code, where Rust would abort it. For a program that is the process: allocations of Rust end so only in the
/// executable `druse`.
pub(crate) fn end_on_exhaustion(cause: Exhausted, words: &str, json: &str, code: u8) {
    super::ffi::end_on_exhaustion(cause == Exhausted::Threads, words, json, i32::from(code));
}

/// Peak memory of the process, bytes; `None` if the system does not report it.
pub fn peak_memory() -> Option<u64> {
    status("VmHWM:")
}

/// Current memory of the process, bytes; `None` if the system does not report it.
pub fn resident_memory() -> Option<u64> {
    status("VmRSS:")
}

/// Address space of the process, bytes; `None` if the system does not report it.
pub(super) fn address_space() -> Option<u64> {
    status("VmSize:")
}

fn status(key: &str) -> Option<u64> {
    let text = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix(key))?;
    let kib: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kib * 1024)
}
