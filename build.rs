//! Builds the bridge to OpenVDB: cxx's glue, then `cpp/` through CMake. Without the feature `vdb`
//! there is nothing to do.

fn main() {
    println!("cargo::rerun-if-changed=build.rs");
    #[cfg(feature = "vdb")]
    if let Err(message) = bridge::build() {
        // One readable line; cargo ends the build after it.
        println!("cargo::error={message}");
    }
}

#[cfg(feature = "vdb")]
mod bridge {
    use std::env;
    use std::path::{Path, PathBuf};
    use std::process::{Command, Stdio};

    const PACKAGES: &str = "apt-get install g++ make cmake libopenvdb-dev libnanovdb-dev libboost-dev libboost-iostreams-dev zlib1g-dev";

    pub fn build() -> Result<(), String> {
        println!("cargo::rerun-if-changed=cpp");
        println!("cargo::rerun-if-changed=src/vdb/ffi.rs");
        for variable in ["DOCS_RS", "DRUSE_OPENVDB_PREFIX", "CXX", "CMAKE"] {
            println!("cargo::rerun-if-env-changed={variable}");
        }
        // docs.rs has no OpenVDB, and rustdoc links nothing.
        if env::var_os("DOCS_RS").is_some() {
            return Ok(());
        }
        let prefix = PathBuf::from(env::var_os("DRUSE_OPENVDB_PREFIX").unwrap_or("/usr".into()));
        let finder = requirements(&prefix)
            .map_err(|missing| format!("{missing} is missing; on Debian 12: {PACKAGES}"))?;

        let root = PathBuf::from(env::var_os("CARGO_MANIFEST_DIR").ok_or("not run by cargo")?);
        let out = PathBuf::from(env::var_os("OUT_DIR").ok_or("not run by cargo")?);
        // The glue sees only bridge.h, which includes no OpenVDB header.
        cxx_build::bridge("src/vdb/ffi.rs")
            .std("c++17")
            .include(root.join("cpp"))
            .compile("druse_glue");
        if is_only_read() {
            return Ok(());
        }
        let library = cmake::Config::new("cpp")
            .profile("Release")
            .define("CXXBRIDGE_INCLUDE", out.join("cxxbridge/include"))
            .define("OPENVDB_FINDER", finder)
            .define("OPENVDB_ROOT", &prefix)
            .build_target("druse_vdb")
            .build();
        let built = library.join("build");
        println!("cargo::rustc-link-search=native={}", built.display());
        println!("cargo::rustc-link-lib=static=druse_vdb");
        // The program's allocations, in Rust too, pass through cpp/allocation.cc.
        for name in ["malloc", "calloc", "realloc", "posix_memalign"] {
            println!("cargo::rustc-link-arg-bins=-Wl,--wrap={name},--undefined=__wrap_{name}");
        }
        let list = std::fs::read_to_string(built.join("libraries.txt"))
            .map_err(|e| format!("the list of libraries that CMake writes: {e}"))?;
        for path in list.lines().map(Path::new) {
            let file = path.file_name().unwrap_or_default().to_string_lossy();
            let name = file.trim_start_matches("lib").split(".so").next();
            if let (Some(place), Some(name)) = (path.parent(), name) {
                println!("cargo::rustc-link-search=native={}", place.display());
                println!("cargo::rustc-link-lib=dylib={name}");
            }
        }
        Ok(())
    }

    /// Whether clippy reads the crate: it links nothing, and would build the C++ side for itself alone.
    fn is_only_read() -> bool {
        env::var_os("RUSTC_WORKSPACE_WRAPPER")
            .is_some_and(|w| Path::new(&w).ends_with("clippy-driver"))
    }

    /// Looks for all that the C++ side needs; the directory of FindOpenVDB.cmake, or what is missing.
    fn requirements(prefix: &Path) -> Result<PathBuf, String> {
        let program = |variable: &str, fallback: &str| {
            let name = env::var(variable).unwrap_or(fallback.into());
            let mut call = Command::new(&name);
            call.arg("--version")
                .stdout(Stdio::null())
                .stderr(Stdio::null());
            match call.status() {
                Ok(status) if status.success() => Ok(()),
                _ => Err(format!("the program {name}")),
            }
        };
        program("CXX", "c++")?;
        program("CMAKE", "cmake")?;
        let include = prefix.join("include");
        for header in [
            "openvdb/openvdb.h",
            "boost/uuid/uuid.hpp",
            "boost/any.hpp",
            "zlib.h",
            "nanovdb/NanoVDB.h",
        ] {
            let own = include.join(header);
            let system = Path::new("/usr/include").join(header);
            if !own.exists() && (header.starts_with("openvdb") || !system.exists()) {
                return Err(own.display().to_string());
            }
        }
        let version =
            std::fs::read_to_string(include.join("openvdb/version.h")).unwrap_or_default();
        let major = version
            .lines()
            .find_map(|l| l.strip_prefix("#define OPENVDB_LIBRARY_MAJOR_VERSION_NUMBER "));
        if major.map(str::trim) != Some("10") {
            return Err(format!(
                "OpenVDB 10 ({} is of version {})",
                include.join("openvdb").display(),
                major.unwrap_or("unknown")
            ));
        }
        // Debian: lib/<multiarch triplet>/cmake/OpenVDB; OpenVDB's own install: lib/cmake/OpenVDB.
        let lib = prefix.join("lib");
        let mut places: Vec<PathBuf> = std::fs::read_dir(&lib)
            .into_iter()
            .flatten()
            .flatten()
            .map(|entry| entry.path().join("cmake/OpenVDB"))
            .collect();
        places.sort();
        places.insert(0, lib.join("cmake/OpenVDB"));
        places
            .into_iter()
            .find(|place| place.join("FindOpenVDB.cmake").exists())
            .ok_or_else(|| format!("FindOpenVDB.cmake under {}", lib.display()))
    }
}
