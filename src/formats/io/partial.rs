//! Partial files: their names, their locks, and the removal of those whose process is gone.
//!
//! An output is written as `.NAME.MACHINE.XXXXXX.partial.EXT` beside its target. Its process holds a lock on it, which
//! the system releases however the process ends: a free lock tells more than a number of a process, which another one
//! may have by now. Locks of other hosts may not be seen on a shared disk, so MACHINE names the host and its start.

use rustix::fs::{FlockOperation, flock};
use std::collections::BTreeSet;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io;
use std::os::unix::fs::PermissionsExt;
use std::path::{Path, PathBuf};
use std::sync::{LazyLock, Mutex, PoisonError};
use std::time::{Duration, SystemTime, UNIX_EPOCH};
use tempfile::{Builder, NamedTempFile, TempDir};

/// The word in the name of every partial file.
const PARTIAL: &str = "partial";
/// Greatest number of bytes of the target's name in that of its partial file: systems allow 255 in all.
const MAX_NAME_BYTES: usize = 128;
/// Characters of each half of a machine's name.
const HASH_CHARS: usize = 8;

/// Folders whose abandoned files this process has removed.
static SWEPT_FOLDERS: Mutex<BTreeSet<PathBuf>> = Mutex::new(BTreeSet::new());

/// The host and its start, as names of partial files show them: hashes, since a host's name may be long and private.
struct Machine {
    host: String,
    start: String,
    /// When the host started, if the system states it.
    started: Option<SystemTime>,
}

static MACHINE: LazyLock<Machine> = LazyLock::new(|| {
    let hash = |path: &str| {
        let text = fs::read(path).unwrap_or_default();
        blake3::hash(&text).to_hex()[..HASH_CHARS].to_owned()
    };
    let statistics = fs::read_to_string("/proc/stat").unwrap_or_default();
    let seconds = statistics
        .lines()
        .find_map(|l| l.strip_prefix("btime "))
        .and_then(|s| s.trim().parse().ok());
    Machine {
        host: hash("/proc/sys/kernel/hostname"),
        start: hash("/proc/sys/kernel/random/boot_id"),
        started: seconds.map(|s| UNIX_EPOCH + Duration::from_secs(s)),
    }
});

/// Creates the partial file of a target in its folder, locked where the file system has locks, with the
/// permissions of a new file; a name that is not UTF-8 is an error of the kind [`io::ErrorKind::InvalidFilename`]. The
/// first call for a folder removes abandoned files there.
pub(super) fn create(target: &Path) -> io::Result<NamedTempFile> {
    let folder = folder_of(target);
    let name = target.file_name().and_then(|n| n.to_str());
    let name = name.ok_or(io::ErrorKind::InvalidFilename)?;
    let extension = target.extension().and_then(|e| e.to_str());
    let prefix = prefix(name);
    let suffix = extension.map_or_else(|| format!(".{PARTIAL}"), |e| format!(".{PARTIAL}.{e}"));
    remove_abandoned(folder);
    loop {
        let file = Builder::new()
            .prefix(&prefix)
            .suffix(&suffix)
            .permissions(Permissions::from_mode(0o666))
            .tempfile_in(folder)?;
        // Another process may judge the file between its creation and its lock, and remove it.
        if lock(file.as_file()) != Lock::Taken && file.path().symlink_metadata().is_ok() {
            return Ok(file);
        }
    }
}

/// A folder for files that are not kept: gone with the value, or with the next partial file beside it if the process
/// is killed.
#[doc(hidden)]
pub struct PartialFolder {
    folder: TempDir,
    #[expect(dead_code, reason = "its lock is held until it is dropped")]
    lock: File,
}

impl PartialFolder {
    /// Creates the folder `.NAME.MACHINE.XXXXXX.partial` in another one.
    ///
    /// # Errors
    /// What the system finds wrong with the folder.
    pub fn create(parent: &Path, name: &str) -> io::Result<Self> {
        remove_abandoned(parent);
        let suffix = format!(".{PARTIAL}");
        loop {
            let mut builder = Builder::new();
            let builder = builder.suffix(&suffix);
            let folder = builder.prefix(&prefix(name)).tempdir_in(parent)?;
            // As in `create`: another process may have removed it before the lock.
            if let Ok(opened) = File::open(folder.path())
                && lock(&opened) != Lock::Taken
                && folder.path().is_dir()
            {
                return Ok(Self {
                    folder,
                    lock: opened,
                });
            }
        }
    }

    /// The folder.
    pub fn path(&self) -> &Path {
        self.folder.path()
    }
}

/// The folder of a file; "." for a name without one.
pub(super) fn folder_of(path: &Path) -> &Path {
    match path.parent() {
        Some(p) if !p.as_os_str().is_empty() => p,
        _ => Path::new("."),
    }
}

/// The start of a partial file's name, cut at a whole character.
fn prefix(name: &str) -> String {
    let end = (0..=name.len().min(MAX_NAME_BYTES)).rfind(|&n| name.is_char_boundary(n));
    let Machine { host, start, .. } = &*MACHINE;
    format!(".{}.{host}-{start}.", &name[..end.unwrap_or(0)])
}

/// What became of the request for a lock.
#[derive(PartialEq)]
enum Lock {
    Held,
    /// Another process holds it.
    Taken,
    /// The file system has no locks.
    Unknown,
}

/// Requests the lock of a file without waiting for it.
fn lock(file: &File) -> Lock {
    match flock(file, FlockOperation::NonBlockingLockExclusive) {
        Ok(()) => Lock::Held,
        Err(rustix::io::Errno::WOULDBLOCK) => Lock::Taken,
        Err(_) => Lock::Unknown,
    }
}

/// Removes the partial files in a folder whose processes are gone. Only the first call for a folder does so: a
/// listing for each of many files would take long.
fn remove_abandoned(folder: &Path) {
    let mut swept = SWEPT_FOLDERS.lock().unwrap_or_else(PoisonError::into_inner);
    if !swept.insert(folder.to_owned()) {
        return;
    }
    drop(swept);
    for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let Some((host, start)) = name.to_str().and_then(machine_of) else {
            continue;
        };
        // Links and pipes with such a name come from elsewhere.
        let (path, kind) = (entry.path(), entry.file_type());
        let opened = match kind {
            Ok(kind) if kind.is_file() => OpenOptions::new().read(true).write(true).open(&path),
            Ok(kind) if kind.is_dir() => File::open(&path),
            _ => continue,
        };
        let Ok(file) = opened else { continue };
        if !is_of_this_machine(host, start, &file) || lock(&file) != Lock::Held {
            continue;
        }
        // Removed while the lock is held, so that a writer that has just created it sees that it is gone.
        let _ = match kind {
            Ok(kind) if kind.is_dir() => fs::remove_dir_all(&path),
            _ => fs::remove_file(&path),
        };
    }
}

/// Host and start in the name of a partial file; `None` for the name of any other file.
fn machine_of(name: &str) -> Option<(&str, &str)> {
    let rest = name.strip_prefix('.')?;
    let (before, extension) = rest.rsplit_once(&format!(".{PARTIAL}"))?;
    let is_extension = extension.is_empty() || extension.starts_with('.');
    let (before, random) = before.rsplit_once('.')?;
    let (_, machine) = before.rsplit_once('.')?;
    let (host, start) = machine.split_once('-')?;
    let is_hash = |text: &str| {
        text.len() == HASH_CHARS && text.bytes().all(|b| b"0123456789abcdef".contains(&b))
    };
    // `tempfile` makes six random characters.
    let is_random = random.len() == 6 && random.bytes().all(|b| b.is_ascii_alphanumeric());
    (is_extension && is_random && is_hash(host) && is_hash(start)).then_some((host, start))
}

/// Whether a free lock proves that the process of a partial file is gone: it ran on this host since its start, or
/// before it and has written nothing since. `host` and `start` are the words in the file's name.
fn is_of_this_machine(host: &str, start: &str, file: &File) -> bool {
    let machine = &*MACHINE;
    if host != machine.host {
        return false;
    }
    let written = file.metadata().and_then(|m| m.modified()).ok();
    let is_before = written.zip(machine.started).is_some_and(|(w, s)| w < s);
    start == machine.start || is_before
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let entries = fs::read_dir(folder).unwrap();
        let mut names: Vec<String> = entries
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    /// The name of a partial file of a machine.
    fn named(host: &str, start: &str, random: &str) -> String {
        format!(".a.vdb.{host}-{start}.{random}.partial.vdb")
    }

    #[test]
    fn only_files_of_ended_processes_of_this_machine_are_removed() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let Machine { host, start, .. } = &*MACHINE;
        let put = |name: &str| {
            fs::write(folder.join(name), "begun").unwrap();
            folder.join(name)
        };
        let abandoned = put(&named(host, start, "aaaaaa"));
        let earlier = put(&named(host, "00000000", "bbbbbb"));
        let long_ago = SystemTime::UNIX_EPOCH + Duration::from_secs(1_000_000_000);
        let file = OpenOptions::new().write(true).open(&earlier).unwrap();
        file.set_modified(long_ago).unwrap();
        let directory = folder.join(format!(".druse-repeat.{host}-{start}.cccccc.partial"));
        fs::create_dir(&directory).unwrap();
        fs::write(directory.join("a.stl"), "made").unwrap();

        let elsewhere = put(&named("00000000", start, "dddddd"));
        let file = OpenOptions::new().write(true).open(&elsewhere).unwrap();
        file.set_modified(long_ago).unwrap();
        let restarted = put(&named(host, "00000000", "eeeeee"));
        let working = put(&named(host, start, "ffffff"));
        let held = File::open(&working).unwrap();
        flock(&held, FlockOperation::LockExclusive).unwrap();
        let users = [
            put(".a.vdb.abcdef.partial.vdb"),
            put(".notes.partial"),
            put(&format!("a.vdb.{host}-{start}.aaaaaa.partial.vdb")),
            put(&format!(".a.vdb.{host}-{start}.aaaaaaa.partial.vdb")),
            put(&format!(".a.vdb.{host}-{start}.aaaaaa.partially")),
        ];
        let target = put("target");
        let link = folder.join(named(host, start, "gggggg"));
        std::os::unix::fs::symlink(&target, &link).unwrap();

        let made = create(&folder.join("b.stl")).unwrap();
        let kept = [elsewhere, restarted, working, target, link];
        for path in kept.iter().chain(&users) {
            assert!(path.symlink_metadata().is_ok(), "{}", path.display());
        }
        for path in [abandoned, earlier, directory] {
            assert!(!path.exists(), "{}", path.display());
        }
        assert_eq!(names(folder).len(), kept.len() + users.len() + 1);
        assert!(made.path().exists());
    }

    #[test]
    fn names_stay_within_what_file_systems_take() {
        let folder = tempfile::tempdir().unwrap();
        for name in [
            "\u{1f9ca}".repeat(60),
            "\u{4e2d}".repeat(80),
            "a".repeat(240),
        ] {
            let file = create(&folder.path().join(format!("{name}.vdb"))).unwrap();
            let name = file.path().file_name().unwrap().to_str().unwrap();
            assert!(machine_of(name).is_some(), "{name}");
        }
    }
}
