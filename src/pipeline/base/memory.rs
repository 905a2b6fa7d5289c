//! Available memory and the memory that the process uses, bytes, from `/proc` and the control groups of Linux.
//! Every figure is absent, or 0, where the system does not report it; nothing here fails.

use rustix::process::{Resource, getrlimit};
use std::fs;

/// Bytes that the process may still use: the machine's available memory, the rest of the limit of the root control
/// group or of its own, whichever is least. `None` where the system reports none of them.
pub(crate) fn available() -> Option<u64> {
    let machine = kibibytes("/proc/meminfo", "MemAvailable:");
    let own = [
        own_limit(Resource::As, "VmSize:"),
        own_limit(Resource::Data, "VmData:"),
    ];
    let all = [machine, control_group()].into_iter().chain(own);
    all.flatten().min()
}

/// The rest of a limit of the process (`ulimit`): the soft limit less what `/proc/self/status` reports under the
/// key `used`. `None` without a limit.
fn own_limit(resource: Resource, used: &str) -> Option<u64> {
    let limit = getrlimit(resource).current?;
    Some(limit.saturating_sub(kibibytes("/proc/self/status", used)?))
}

/// The rest of the memory limit at the root of the control groups, bytes, of version 2 or else 1: in a container the
/// process's own. `None` without one, as at the root of version 2 or with `max`, which is no number.
fn control_group() -> Option<u64> {
    let read = |path: &str| fs::read_to_string(path).ok()?.trim().parse::<u64>().ok();
    let v2 = read("/sys/fs/cgroup/memory.max").zip(read("/sys/fs/cgroup/memory.current"));
    let v1 = || {
        read("/sys/fs/cgroup/memory/memory.limit_in_bytes")
            .zip(read("/sys/fs/cgroup/memory/memory.usage_in_bytes"))
    };
    let (limit, used) = v2.or_else(v1)?;
    Some(limit.saturating_sub(used))
}

/// Peak resident size of this process, bytes; 0 where the system does not report it.
pub(crate) fn peak() -> u64 {
    kibibytes("/proc/self/status", "VmHWM:").unwrap_or(0)
}

/// Current resident size of this process, bytes; 0 where the system does not report it.
pub(crate) fn resident() -> u64 {
    kibibytes("/proc/self/status", "VmRSS:").unwrap_or(0)
}

/// The value of a key of a file under `/proc`, bytes. The files give KiB.
fn kibibytes(path: &str, key: &str) -> Option<u64> {
    let text = fs::read_to_string(path).ok()?;
    let line = text.lines().find_map(|l| l.strip_prefix(key))?;
    Some(line.split_whitespace().next()?.parse::<u64>().ok()? * 1024)
}
