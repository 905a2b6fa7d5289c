//! `druse scaffold make PART -o X.msh`: a scaffold of tets from a mesh or a part of CAD.

use super::context::Session;
use super::failure::Failure;
use super::output::require_output;
use crate::frame::LengthUnit;
use crate::io::ReadError;
use crate::io::atomic::write_bytes;
use crate::mesh::{MeshSolid, RepairKind};
use crate::pipeline::{CadMesh, CadOptions, RunError, TetFilling, Warning, cad_mesh};
use crate::recipe::{Size, is_cad};
use crate::scaffold::{FillOptions, Scaffold};
use clap::Args;
use std::path::PathBuf;

#[derive(Args)]
pub(super) struct MakeFlags {
    /// The part: a closed mesh (.stl .obj .ply .off .3mf), or .step, .iges, .brep, which the program gmsh meshes.
    part: PathBuf,
    /// The scaffold to write (.msh or .vtu).
    #[arg(short, long, value_name = "X.msh")]
    pub output: PathBuf,
    /// Edge of a tet, as in 5mm; a bare number is in the part's unit.
    #[arg(long, value_name = "LENGTH")]
    cell_size: Size,
    /// 1 for straight tets, 2 for curved ones [default: 2 where the surface is curved].
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..=2))]
    order: Option<u32>,
    /// Unit of the part's numbers [default: the file's, else mm].
    #[arg(long)]
    unit: Option<LengthUnit>,
    /// Also write a picture of the scaffold.
    #[arg(long, value_name = "X.png")]
    picture: Option<PathBuf>,
}

/// Width and height of the picture.
const PICTURE_SIZE: [usize; 2] = [1000, 800];

impl MakeFlags {
    /// Makes the scaffold and writes it, and its picture.
    pub(super) fn write(&self, session: &Session) -> Result<(), Failure> {
        require_output(&self.output, &["msh", "vtu"])?;
        let extension = self.output.extension();
        let is_msh = extension.is_some_and(|e| e.eq_ignore_ascii_case("msh"));
        if let Some(picture) = &self.picture {
            require_output(picture, &["png"])?;
        }
        let unit = self.unit()?;
        let cell = self.cell_size.0.in_unit(unit, unit).ok_or_else(|| {
            Failure::usage("there are no voxels here; expected a length as in --cell-size 5mm")
        })?;
        if is_cad(&self.part) {
            let options = CadOptions {
                cell,
                order: self.order.unwrap_or(2), // as of a part in a recipe
                is_scaffold: true,
            };
            let CadMesh { path: mesh, volume } = cad_mesh(&self.part, options, session)?;
            let read = crate::io::read_scaffold(&mesh);
            // The part is at fault, not the file of gmsh.
            let read = read.map_err(|e| {
                let message = format!("found {}; expected {}", e.found(), e.expected());
                Failure::data(&self.part, message)
            })?;
            let scaffold = read.scaffold;
            let found = TetFilling::of_cad(&scaffold, volume);
            for warning in found.map_err(|e| Failure::data(&self.part, e))? {
                session.warn_of(TetFilling::CODE, warning)?;
            }
            if is_msh {
                // The file of gmsh itself, because it has the groups.
                let bytes = std::fs::read(&mesh).map_err(|e| ReadError::io(&mesh, e))?;
                write_bytes(&self.output, &bytes)?;
            } else {
                crate::io::write_vtu(&self.output, &scaffold, &[])?;
            }
        } else {
            let scaffold = self.filling(cell, session)?;
            if is_msh {
                crate::io::write_msh(&self.output, &scaffold)?;
            } else {
                crate::io::write_vtu(&self.output, &scaffold, &[])?;
            }
        }
        if let Some(picture) = &self.picture {
            // 0: as many threads as cores.
            write_bytes(
                picture,
                &super::preview::png(&self.output, PICTURE_SIZE, 0, session)?,
            )?;
        }
        Ok(())
    }

    /// The unit of the part's numbers: that of the flag, else of the file, else millimetres.
    fn unit(&self) -> Result<LengthUnit, Failure> {
        let stated = match self.unit {
            Some(unit) => Some(unit),
            None if is_cad(&self.part) => None,
            None => crate::io::stated_unit(&self.part)?,
        };
        Ok(stated.unwrap_or(LengthUnit::Millimetre))
    }

    /// The part filled with tets of the edge `cell`. Repairs and what the tets leave of the part become warnings.
    fn filling(&self, cell: f64, session: &Session) -> Result<Scaffold, Failure> {
        let file = crate::io::read_mesh(&self.part)?;
        for warning in file.warnings {
            session.warn_of(Warning::MESH, warning)?;
        }
        let (solid, repairs) =
            MeshSolid::repaired(file.mesh).map_err(|e| Failure::data(&self.part, e.to_string()))?;
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
        let filling = TetFilling::new(&solid, options, session).map_err(|e| match e {
            RunError::Scaffold { message, .. } => Failure::data(&self.part, message),
            e => e.into(),
        })?;
        for warning in filling.warnings {
            session.warn_of(TetFilling::CODE, warning)?;
        }
        Ok(filling.scaffold)
    }
}
