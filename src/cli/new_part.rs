//! The recipe that `druse new NAME --part FILE` writes: a lattice in a part, with sizes that suit it.

use super::context::Session;
use super::failure::Failure;
use crate::frame::{LengthUnit, Vec3};
use crate::mesh::{MeshSolid, TriMesh};
use crate::pipeline::{CadOptions, cad_mesh, outer_mesh};
use crate::recipe::is_cad;
use std::path::Path;

/// Cells along the longest edge of the part's box, at least and at most.
const CELLS: [f64; 2] = [8.0, 40.0];
/// Thickness of struts and walls, cells; four voxels lie across it.
const WALL: f64 = 0.2;
/// Most places at which the thickness is measured.
const PLACES: usize = 2000;
/// One of so many places may be thinner than the least thickness: steps and noise of the mesh.
const IGNORED: usize = 20;

/// A lattice in a part.
pub(super) struct Lattice<'a> {
    pub part: &'a Path,
    /// "edges", or the name of a surface.
    pub cell: &'a str,
    /// The recipe's name and path.
    pub name: &'a str,
    pub path: &'a Path,
    pub may_overwrite: bool,
}

impl Lattice<'_> {
    /// The text of the recipe. Where cubes fill a part of CAD, its surface is written beside the recipe.
    pub(super) fn recipe(&self, session: &Session) -> Result<String, Failure> {
        let &Self {
            part,
            cell,
            name,
            path,
            ..
        } = self;
        let is_cad = is_cad(part);
        let is_tets = cell == "edges";
        let mesh = surface(part, is_cad, session)?;
        let longest = mesh.bounds().size().amax();
        let (solid, _) =
            MeshSolid::repaired(mesh).map_err(|e| Failure::data(part, e.to_string()))?;
        let thickness = least_thickness(&solid).unwrap_or(longest);
        // As large as the thinnest wall, but neither a few cells nor far too many.
        let size = thickness.clamp(longest / CELLS[1], longest / CELLS[0]);
        let [cell_size, voxel, skin] =
            [size, WALL * size / 4.0, WALL * size].map(|s| two_digits(s).to_string());
        let surface = if is_cad && !is_tets {
            let surface = path.with_file_name(format!("{name}_part.stl"));
            self.write_surface(&surface, size, session)?;
            Some(surface)
        } else {
            None
        };
        let is_meshed_by_gmsh = is_cad && is_tets;
        let file = relative(surface.as_deref().unwrap_or(part), path)?;
        let file = toml::Value::String(file).to_string();
        let thickness = two_digits(thickness).to_string();
        let longest = two_digits(longest).to_string();
        let source = if is_tets {
            "graph = \"edges\"   # round struts along the edges of the tets, so along the part's own edges".to_owned()
        } else {
            format!(
                "surface = {}\nvolume_fraction = 0.3",
                toml::Value::String(cell.to_owned())
            )
        };
        let scaffold = match (is_meshed_by_gmsh, is_tets) {
            (true, _) => {
                format!("file = {file}\ncell_size = {cell_size}   # edge of a tet; gmsh makes them")
            }
            (_, true) => format!(
                "fill = {{ mesh = {file}, cell_size = {cell_size}, kind = \"tet\" }}   # tets keep the part's edges"
            ),
            _ => format!(
                "fill = {{ mesh = {file}, cell_size = {cell_size} }}   # cubes, which the part cuts"
            ),
        };
        let (boundary, thickness_of_struts) = if is_tets {
            (
                "\nboundary = \"extend\"   # struts on the outer faces stay whole",
                format!("\nthickness = {skin}   # of the struts"),
            )
        } else {
            ("", String::new())
        };
        let skin = if is_meshed_by_gmsh {
            String::new()
        } else {
            format!(
                "# A closed skin around the lattice:\n# [[op]]\n\
             # union = {{ skin = {{ mesh = {file}, thickness = {skin} }} }}\n"
            )
        };
        Ok(format!(
            "# A lattice in {file}: its longest edge is {longest}, its thinnest wall about {thickness}.\n\
         druse = 1\nunit = \"mm\"\n\n[cell.lattice]\n{source}\n\n[scaffold]\n{scaffold}{boundary}\n\n\
         [tiling]\ncell = \"lattice\"{thickness_of_struts}\n\n\
         [band]\nvoxel_size = {voxel}   # four across the thinnest strut or wall, about\n\n\
         {skin}[[op]]\nkeep_largest = true   # reports what it dropped\n\n\
         [[output]]\nmesh = \"{name}.stl\"\n[[output]]\npicture = \"{name}.png\"\n[[output]]\nreport = \"{name}.json\"\n"
        ))
    }

    /// Writes the surface of a part of CAD: the outer faces of its curved tets.
    fn write_surface(&self, output: &Path, cell: f64, session: &Session) -> Result<(), Failure> {
        if output.exists() && !self.may_overwrite {
            let message = format!("{} exists already", output.display());
            return Err(Failure::usage(message).hint("choose another name, or add --force"));
        }
        let options = CadOptions {
            cell,
            order: 2,
            is_scaffold: true,
        };
        let tets = cad_mesh(self.part, options, session)?.path;
        let scaffold = crate::io::read_scaffold(&tets)?.scaffold;
        // A fortieth of a voxel.
        let mesh = outer_mesh(&scaffold, WALL * cell / 160.0)
            .map_err(|e| Failure::data(self.part, e.to_string()))?;
        crate::io::write_mesh(output, &mesh, LengthUnit::Millimetre)?;
        Ok(())
    }
}

/// The part's path as the recipe's folder sees it.
fn relative(part: &Path, recipe: &Path) -> Result<String, Failure> {
    let absolute = |p: &Path| std::path::absolute(p).map_err(|e| Failure::data(p, e.to_string()));
    let (part, recipe) = (absolute(part)?, absolute(recipe)?);
    let folder = recipe.parent().unwrap_or(&recipe);
    let short = part.strip_prefix(folder).unwrap_or(&part);
    let shown = short
        .to_str()
        .ok_or_else(|| Failure::data(&part, "the path is no UTF-8"))?;
    Ok(shown.to_owned())
}

fn surface(part: &Path, is_cad: bool, session: &Session) -> Result<TriMesh, Failure> {
    if !is_cad {
        return Ok(crate::io::read_mesh(part)?.mesh);
    }
    // A crude surface is enough to measure: 1e22 is gmsh's own default, which limits no edge.
    let options = CadOptions {
        cell: 1e22,
        order: 1,
        is_scaffold: false,
    };
    let mesh = cad_mesh(part, options, session)?.path;
    Ok(crate::io::read_mesh(&mesh)?.mesh)
}

fn two_digits(value: f64) -> f64 {
    let scale = 10f64.powi(1 - value.log10().floor() as i32);
    (value * scale).round() / scale
}

/// The thickness that all but a few places of the surface exceed.
///
/// A ball inside that touches the surface at p shrinks until it holds no other point of it: with q the point
/// nearest to its centre, the ball through p and q with its centre on the normal n has the radius
/// |p - q|^2 / (2 n . (p - q)). Balls that end at a face beside, as at edges, measure no wall.
fn least_thickness(solid: &MeshSolid) -> Option<f64> {
    let all: Vec<[Vec3; 3]> = solid.surface().map(|(c, _)| c).collect();
    let unit = |[a, b, c]: [Vec3; 3]| (b - a).cross(&(c - a)).try_normalize(0.0);
    let mut found: Vec<f64> = Vec::new();
    for corners in all.iter().step_by(all.len().div_ceil(PLACES).max(1)) {
        let Some(n) = unit(*corners) else { continue };
        let p = corners.iter().sum::<Vec3>() / 3.0;
        let mut radius = solid.bounds().half_diagonal();
        // Each step shrinks the ball to one that both points touch, until it holds none up to rounding; few suffice.
        for _ in 0..16 {
            let near = solid.closest(p - n * radius);
            let way = p - near.point;
            if near.distance > radius * (1.0 - 1e-6) || n.dot(&way) <= 0.0 {
                break;
            }
            radius = way.norm_squared() / (2.0 * n.dot(&way));
            let m = unit(solid.mesh().corners(near.triangle as usize));
            // Faces whose normals differ by less than 120 degrees are no opposite walls.
            if m.is_some_and(|m| m.dot(&n) > -0.5) {
                radius = f64::INFINITY;
                break;
            }
        }
        if radius.is_finite() {
            found.push(2.0 * radius);
        }
    }
    found.sort_by(f64::total_cmp);
    found.get(found.len() / IGNORED).copied()
}
