//! Names of outputs that come with a file, not from the user: whether they stay inside the folder that the user names.
//! A name with a link below the folder is refused; the folder itself may be one.

use std::path::{Component, Path};

/// Why a file of this name would lie outside a folder, as the words after the name; `None` if it stays inside. Only
/// the parts of `name` are checked: `folder` itself may be a link.
///
/// Links below the folder lead to places that the user does not name; they are refused wherever they lead.
#[doc(hidden)]
pub fn leads_out(folder: &Path, name: &Path) -> Option<String> {
    let mut path = folder.to_owned();
    let mut depth = 0;
    for part in name.components() {
        match part {
            Component::Normal(word) => {
                path.push(word);
                depth += 1;
                if path.is_symlink() {
                    return Some(format!("where {} is a link", path.display()));
                }
            }
            Component::CurDir => {}
            Component::ParentDir if depth > 0 => {
                path.pop();
                depth -= 1;
            }
            Component::ParentDir => return Some("which leads out of the folder".into()),
            Component::RootDir | Component::Prefix(_) => {
                return Some("which is an absolute path".into());
            }
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::leads_out;
    use std::path::Path;

    #[test]
    fn only_names_below_the_folder_stay_inside() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        std::fs::create_dir(folder.join("sub")).unwrap();
        std::os::unix::fs::symlink("sub", folder.join("link")).unwrap();
        std::os::unix::fs::symlink("nothing", folder.join("sub/a.vdb")).unwrap();
        for name in [
            "a.vdb",
            "./a.vdb",
            "sub/b.vdb",
            "new/../a.vdb",
            "~/a.vdb",
            "a..vdb",
        ] {
            assert_eq!(leads_out(folder, Path::new(name)), None, "{name}");
        }
        for (name, word) in [
            ("/a.vdb", "absolute"),
            ("../a.vdb", "out"),
            ("sub/../../a.vdb", "out"),
            ("link/b.vdb", "link"),
            ("sub/a.vdb", "link"),
            ("new/../link/b.vdb", "link"),
        ] {
            let reason = leads_out(folder, Path::new(name)).unwrap();
            assert!(reason.contains(word), "{name}: {reason}");
        }
    }
}
