//! Available memory and the memory that the process uses, bytes, from `/proc` and the control groups of Linux.
//! Every figure is absent, or 0, where the system does not report it; nothing here fails.

use rustix::process::{Resource, getrlimit};
use std::fs;
use std::path::Path;

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

/// The least rest of the memory limits of the process's control group and of its parents, bytes. `None` without one.
fn control_group() -> Option<u64> {
    let groups = fs::read_to_string("/proc/self/cgroup").ok()?;
    least_rest(&groups, Path::new("/sys/fs/cgroup"))
}

/// The least rest among the groups that `/proc/self/cgroup` lists, below `root`. A line is `id:controllers:path`;
/// version 2 has no controllers.
fn least_rest(groups: &str, root: &Path) -> Option<u64> {
    let mut least: Option<u64> = None;
    for line in groups.lines() {
        let mut parts = line.splitn(3, ':').skip(1);
        let (Some(controllers), Some(path)) = (parts.next(), parts.next()) else {
            continue;
        };
        let (base, files) = if controllers.is_empty() {
            (root.to_owned(), ["memory.max", "memory.current"])
        } else if controllers.split(',').any(|c| c == "memory") {
            let files = ["memory.limit_in_bytes", "memory.usage_in_bytes"];
            (root.join("memory"), files)
        } else {
            continue;
        };
        // A limit of a parent holds for its children. In a container the path may not exist, but its root does.
        for group in Path::new(path.trim_start_matches('/')).ancestors() {
            // Version 2 writes `max`, which is no number, where there is no limit.
            let [limit, used] = files.map(|name| {
                let text = fs::read_to_string(base.join(group).join(name));
                text.ok()?.trim().parse::<u64>().ok()
            });
            let rest = limit
                .zip(used)
                .map(|(limit, used)| limit.saturating_sub(used));
            least = least.into_iter().chain(rest).min();
        }
    }
    least
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_least_limit_of_a_control_group_and_its_parents_counts() {
        let root = tempfile::tempdir().unwrap();
        let write = |group: &str, files: [(&str, &str); 2]| {
            let folder = root.path().join(group);
            fs::create_dir_all(&folder).unwrap();
            for (name, text) in files {
                fs::write(folder.join(name), text).unwrap();
            }
        };
        let v2 = |limit, used| [("memory.max", limit), ("memory.current", used)];
        write("a", v2("900\n", "300\n"));
        write("a/b", v2("max\n", "200\n"));
        let v1 = [
            ("memory.limit_in_bytes", "500"),
            ("memory.usage_in_bytes", "100"),
        ];
        write("memory/c", v1);
        let least = |groups: &str| least_rest(groups, root.path());
        assert_eq!(least("0::/a/b\n"), Some(600));
        assert_eq!(least("4:cpu,memory:/c/gone\n0::/a/b\n"), Some(400));
        assert_eq!(least("5:cpu:/a\n0::/\n"), None);
    }
}
