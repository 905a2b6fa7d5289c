//! Errors of the library as exceptions of the package, in the words of the command line. The class of an exception
//! follows from its kind (argument, recipe, file or another error); `_errors.py` of the package makes it. An
//! interrupt or a termination is `KeyboardInterrupt`.

use druse::cli::Failure;
use pyo3::exceptions::PyKeyboardInterrupt;
use pyo3::prelude::*;

/// Exit codes of an interrupted and of a terminated program.
const INTERRUPT_CODES: [u8; 2] = [130, 143];
/// Exit codes of missing inputs, outputs that cannot be made, and failures of the system.
const FILE_CODES: [u8; 3] = [66, 73, 74];

/// Why a call failed.
pub(crate) enum Fault {
    /// An error with the kind of its exception, its place and advice; one of a file or the system has the kind `file`.
    Shown(&'static str, Box<Failure>),
    /// An error of an argument.
    Argument(String),
    /// Any other error.
    Text(String),
}

impl Fault {
    /// The exception.
    pub(crate) fn raise(self, py: Python<'_>) -> PyErr {
        // The exceptions are classes of the Python part of the package, which makes them from words and places.
        let make = |kind: &str, message: &str, failure: Option<&Failure>| {
            let place = failure.map_or((None, None), Failure::place);
            let arguments = (
                kind,
                message,
                failure.and_then(Failure::file),
                place.0,
                place.1,
                failure.and_then(Failure::element),
                failure.and_then(Failure::advice),
            );
            let made = py
                .import("druse._errors")
                .and_then(|m| m.getattr("make")?.call1(arguments));
            made.map_or_else(|e| e, PyErr::from_value)
        };
        match self {
            Self::Shown(_, failure) if INTERRUPT_CODES.contains(&failure.code()) => {
                PyKeyboardInterrupt::new_err(())
            }
            Self::Shown(kind, failure) => {
                let is_of_file = FILE_CODES.contains(&failure.code());
                let kind = if is_of_file { "file" } else { kind };
                make(kind, failure.message(), Some(&failure))
            }
            Self::Argument(text) => make("argument", &text, None),
            Self::Text(text) => make("error", &text, None),
        }
    }
}

impl From<Fault> for PyErr {
    fn from(fault: Fault) -> Self {
        Python::attach(|py| fault.raise(py))
    }
}

/// Errors that the command line shows.
macro_rules! shown {
    ($($error:ty => $kind:literal),*) => {
        $(impl From<$error> for Fault {
            fn from(e: $error) -> Self {
                Self::Shown($kind, Box::new(e.into()))
            }
        })*
    };
}

shown!(
    druse::recipe::RecipeError => "recipe",
    druse::io::ReadError => "file",
    druse::io::WriteError => "file",
    druse::vdb::FileError => "file"
);

impl From<druse::pipeline::RunError> for Fault {
    fn from(e: druse::pipeline::RunError) -> Self {
        match e {
            druse::pipeline::RunError::Recipe(e) => e.into(),
            e => Self::Shown("error", Box::new(e.into())),
        }
    }
}

impl From<druse::vdb::VdbError> for Fault {
    fn from(e: druse::vdb::VdbError) -> Self {
        let is_argument = matches!(
            e,
            druse::vdb::VdbError::Parameter { .. } | druse::vdb::VdbError::Value { .. }
        );
        if is_argument {
            return Self::Argument(e.to_string());
        }
        Self::Shown("error", Box::new(e.into()))
    }
}

/// Errors whose text is enough.
macro_rules! argument {
    ($($error:ty),*) => {
        $(impl From<$error> for Fault {
            fn from(e: $error) -> Self {
                Self::Argument(e.to_string())
            }
        })*
    };
}

argument!(
    druse::band::SinkError,
    druse::cell::CellError,
    druse::cell::CellTextError,
    druse::cell::FitError,
    druse::cell::VoxelError,
    druse::homogenize::HomogenizeError,
    druse::inverse::InverseError,
    druse::mesh::MeshError,
    druse::mesh::NoSolidError,
    druse::pipeline::CellFault,
    druse::polymesh::ScriptError,
    druse::scaffold::ScaffoldError,
    druse::tiling::TilingError
);

impl From<druse::band::BandError> for Fault {
    fn from(e: druse::band::BandError) -> Self {
        match e {
            druse::band::BandError::Cancelled(c) => druse::pipeline::RunError::Cancelled(c).into(),
            e => Self::Argument(e.to_string()),
        }
    }
}

impl From<serde_json::Error> for Fault {
    fn from(e: serde_json::Error) -> Self {
        Self::Text(e.to_string())
    }
}
