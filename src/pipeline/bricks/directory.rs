//! The directory of a run's bricks: its lock, and which of its files are Druse's.
//!
//! Only those are ever removed or replaced. The directory may be a link, and may hold a user's files.

use super::PLAN_FILE;
use crate::band::{ATTRIBUTE_FILE_MAGIC, LEAF_FILE_MAGIC};
use crate::io::WriteError;
use crate::pipeline::base::error::RunError;
use crate::recipe::{OutputKind, Recipe};
use rustix::fs::{Access, FlockOperation, access, flock};
use rustix::io::Errno;
use serde::Deserialize;
use serde::de::IgnoredAny;
use std::fs;
use std::fs::File;
use std::io::{ErrorKind, Read};
use std::os::unix::fs::MetadataExt;
use std::path::{Path, PathBuf};

/// File name of the lock.
const LOCK_FILE: &str = "lock";
/// Times that a run tries to lock a directory that the run before is removing. It tries again at once, without a
/// pause.
const LOCK_ATTEMPTS: usize = 100;

/// The brick directory of a run: `.NAME.bricks` beside its first volume, or its first output without one; NAME is `run`
/// without outputs. `out` is the folder of the outputs, if the user gives one.
pub(crate) fn directory_beside(recipe: &Recipe, out: Option<&Path>) -> PathBuf {
    let outputs = &recipe.sections().output;
    let named = || outputs.iter().flat_map(|o| o.named());
    let vdb = named().find(|(kind, _)| *kind == OutputKind::Vdb);
    let path = vdb.or_else(|| named().next()).map(|(_, path)| path);
    let target =
        crate::pipeline::outputs::output::target(recipe, out, path.unwrap_or(Path::new("run")));
    let name = target.file_name().unwrap_or_default().to_string_lossy();
    target.with_file_name(format!(".{name}.bricks"))
}

/// The directory or its nearest existing ancestor.
pub(super) fn nearest_existing(directory: &Path) -> &Path {
    let mut existing_ancestors = directory.ancestors().filter(|d| d.is_dir());
    // The last ancestor of a relative path is empty and stands for the working directory.
    existing_ancestors.next().unwrap_or(Path::new("."))
}

/// Creates the directory if it does not exist. It may be a link to a directory.
pub(super) fn make_directory(directory: &Path) -> Result<(), WriteError> {
    fs::create_dir_all(directory).map_err(|e| WriteError::Create {
        path: directory.to_owned(),
        reason: match e.kind() {
            ErrorKind::AlreadyExists => {
                "found a file or a link to nothing; expected a folder for bricks".into()
            }
            _ => e.to_string(),
        },
    })
}

/// The lock of a run on its directory. The system releases it however the process ends; its file goes with it.
pub(super) struct Lock {
    path: PathBuf,
    #[expect(dead_code, reason = "held until dropped")]
    file: File,
}

impl Lock {
    /// Creates a directory, if it does not exist, and locks it.
    ///
    /// # Errors
    /// [`RunError::Busy`] when another run holds the lock. File systems without locks are used
    /// unlocked.
    pub fn take(directory: &Path) -> Result<Self, RunError> {
        let path = directory.join(LOCK_FILE);
        for _ in 0..LOCK_ATTEMPTS {
            make_directory(directory)?;
            refuse_foreign(&path)?;
            let mut options = File::options();
            let file = match options.create(true).truncate(false).write(true).open(&path) {
                // The run before has just removed the directory: it is made again.
                Err(e) if e.kind() == ErrorKind::NotFound => continue,
                opened => opened.map_err(|e| WriteError::Create {
                    path: path.clone(),
                    reason: e.to_string(),
                })?,
            };
            // Any other error means a file system without locks; the run goes on unlocked.
            if let Err(Errno::WOULDBLOCK) = flock(&file, FlockOperation::NonBlockingLockExclusive) {
                break;
            }
            // The run before may have removed the file after it was opened here; its lock would be no other run's.
            let identity = |m: fs::Metadata| (m.dev(), m.ino());
            let locked = file.metadata().map(identity).ok();
            if locked.is_some() && locked == fs::metadata(&path).map(identity).ok() {
                return Ok(Self { path, file });
            }
        }
        Err(RunError::Busy(directory.to_owned()))
    }

    /// As [`Lock::take`], for a directory that may be missing or closed to writing, where nothing is to lock and
    /// the result is `None`.
    pub fn take_of_existing(directory: &Path) -> Result<Option<Self>, RunError> {
        let is_open = directory.is_dir() && access(directory, Access::WRITE_OK).is_ok();
        is_open.then(|| Self::take(directory)).transpose()
    }
}

impl Drop for Lock {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Removes those of Druse's files whose names `is_unwanted` admits, except for the lock. Files that cannot be
/// removed stay.
pub(super) fn clear(directory: &Path, is_unwanted: impl Fn(&str) -> bool) {
    for entry in fs::read_dir(directory).into_iter().flatten().flatten() {
        let name = entry.file_name();
        let name = name.to_string_lossy();
        if name != LOCK_FILE && is_unwanted(&name) && is_made_by_druse(&entry.path()) {
            let _ = fs::remove_file(entry.path());
        }
    }
}

/// Removes Druse's files and then the directory, if it holds nothing else and is no link.
pub(super) fn remove(directory: &Path, lock: Lock) {
    clear(directory, |_| true);
    drop(lock);
    let _ = fs::remove_dir(directory);
}

/// Refuses to replace a file of a brick directory that Druse did not make; an absent file passes.
pub(super) fn refuse_foreign(path: &Path) -> Result<(), WriteError> {
    if path.symlink_metadata().is_err() || is_made_by_druse(path) {
        return Ok(());
    }
    Err(WriteError::Create {
        path: path.to_owned(),
        reason: "found something under this name that Druse did not make; expected nothing there: \
                 move it out of the folder of the bricks"
            .into(),
    })
}

/// The keys by which a plan is known.
#[derive(Deserialize)]
#[expect(dead_code, reason = "only their presence counts")]
struct PlanKeys {
    druse: String,
    recipe_blake3: String,
    bricks: IgnoredAny,
}

/// Whether Druse made a file of a brick directory, by its name and its first bytes. It makes no links.
fn is_made_by_druse(path: &Path) -> bool {
    let Ok(meta) = path.symlink_metadata() else {
        return false;
    };
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if !meta.is_file() {
        return false;
    }
    match &*name {
        LOCK_FILE => meta.len() == 0,
        PLAN_FILE => {
            let text = fs::read(path).unwrap_or_default();
            serde_json::from_slice::<PlanKeys>(&text).is_ok()
        }
        name => brick_magic(name).is_some_and(|magic| {
            let mut start = [0; 8];
            // What a failing disk has cut off begins as a whole one does.
            let read = File::open(path).and_then(|mut f| f.read(&mut start));
            read.is_ok_and(|n| magic.starts_with(&start[..n]))
        }),
    }
}

/// The first bytes of a brick's file; `None` for the name of any other file.
fn brick_magic(name: &str) -> Option<&'static [u8; 8]> {
    let mut words = name.strip_prefix("brick-")?.split('.');
    let is_number = |w: &str| !w.is_empty() && w.bytes().all(|b| b.is_ascii_digit());
    let is_hash = |w: &str| w.len() == 16 && w.bytes().all(|b| b.is_ascii_hexdigit());
    let number = words.next().filter(|w| w.len() >= 6 && is_number(w));
    number?;
    match words.collect::<Vec<_>>()[..] {
        ["leaves"] => Some(LEAF_FILE_MAGIC),
        [pass, "leaves"] if is_number(pass) => Some(LEAF_FILE_MAGIC),
        [word, "numbers"] if is_hash(word) => Some(ATTRIBUTE_FILE_MAGIC),
        _ => None,
    }
}

/// Whether a file derives from the bricks of the first pass: a later pass or attributes.
pub(super) fn is_derived(name: &str) -> bool {
    // brick-000017.leaves, brick-000017.1.leaves, brick-000017.WORD.numbers
    name.starts_with("brick-") && name.split('.').count() > 2
}

/// Total size of the bricks in the directory, bytes.
pub(super) fn size_of(directory: &Path) -> u64 {
    let entries = fs::read_dir(directory).into_iter().flatten().flatten();
    entries
        .filter(|e| brick_magic(&e.file_name().to_string_lossy()).is_some())
        .filter_map(|e| e.metadata().ok())
        .map(|m| m.len())
        .sum()
}
