//! `druse scaffold make PART -o X.msh`: a scaffold of tets from a mesh or a part of CAD.

use super::context::Session;
use super::failure::Failure;
use crate::frame::LengthUnit;
use crate::io::atomic::require_writable;
use crate::mesh::{MeshSolid, RepairKind};
use crate::pipeline::{CadOptions, TetFilling, Warning, cad_mesh};
use crate::recipe::{Size, is_cad};
use crate::scaffold::{FillOptions, Scaffold};
use std::path::Path;

/// What is made.
pub(super) struct Made<'a> {
    pub part: &'a Path,
    pub output: &'a Path,
    pub size: Size,
    pub order: Option<u32>,
    pub unit: Option<LengthUnit>,
}

impl Made<'_> {
    /// Makes the scaffold and writes it.
    pub(super) fn write(&self, session: &Session) -> Result<(), Failure> {
        let extension = self
            .output
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase());
        let is_msh = match extension.as_deref() {
            Some("msh") => true,
            Some("vtu") => false,
            _ => {
                let found = self.output.display();
                return Err(Failure::usage(format!(
                    "found the output {found}; expected a name with the extension .msh or .vtu"
                )));
            }
        };
        require_writable(self.output)?;
        let scaffold = self.scaffold(session)?;
        if is_msh {
            crate::io::write_msh(self.output, &scaffold)?;
        } else {
            crate::io::write_vtu(self.output, &scaffold, &[])?;
        }
        Ok(())
    }

    /// Tets that fill the part: by gmsh in a CAD part, by this program in a mesh.
    fn scaffold(&self, session: &Session) -> Result<Scaffold, Failure> {
        let stated = match self.unit {
            Some(unit) => Some(unit),
            // gmsh converts CAD parts to millimetres.
            None if is_cad(self.part) => None,
            None => crate::io::stated_unit(self.part)?,
        };
        let unit = stated.unwrap_or(LengthUnit::Millimetre);
        let cell = self.size.0.in_unit(unit, unit).ok_or_else(|| {
            Failure::usage("there are no voxels here; expected a length as in --cell-size 5mm")
        })?;
        let failed = |message: String| Failure::data(self.part, message);
        if is_cad(self.part) {
            let options = CadOptions {
                cell,
                order: self.order.unwrap_or(2),
            };
            let mesh = cad_mesh(self.part, options).map_err(failed)?;
            return Ok(crate::io::read_scaffold(&mesh)?.scaffold);
        }
        let file = crate::io::read_mesh(self.part)?;
        for warning in file.warnings {
            session.warn_of(Warning::MESH, warning)?;
        }
        let (solid, repairs) = MeshSolid::repaired(file.mesh).map_err(|e| failed(e.to_string()))?;
        for repair in repairs {
            let code = match repair.kind {
                RepairKind::United | RepairKind::Repeated => Warning::OVERLAP,
                RepairKind::Flipped | RepairKind::Closed => Warning::MESH,
            };
            session.warn_of(code, repair.to_string())?;
        }
        let options = FillOptions {
            cell,
            order: self.order,
        };
        let filling = TetFilling::new(&solid, options).map_err(failed)?;
        for warning in filling.warnings {
            session.warn_of(TetFilling::CODE, warning)?;
        }
        Ok(filling.scaffold)
    }
}
