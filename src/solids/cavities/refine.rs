//! Distances of single voxels from the surface, by triangles instead of points on lattice edges.
//!
//! A distance to the points where lattice edges cross the surface is never less than that to the surface. Around a
//! cavity's deepest voxel and its throat the surface is therefore taken as triangles: in each cell of eight voxels six
//! tetrahedra with linear values. Only the narrowest cavities are refined, since each costs a cube of voxels. The law
//! `random_networks_have_the_cavities_of_a_flood` allows 0.3 voxel against points on all edges of the tetrahedra.

use super::{Cavity, Measure};
use crate::Task;
use crate::dense::DenseValues;
use crate::leaf_source::LeafSource;
use druse_geometry::frame::{Coord, Vec3};
use druse_geometry::mesh::closest_point;
use druse_tilings::band::Region;
use rayon::prelude::*;

/// Greatest number of cavities, narrowest first, whose radii are refined.
const MAX_REFINED: usize = 1000;
/// Corners of a cell by number: bit 2 is x, bit 1 is y, bit 0 is z.
const CORNERS: usize = 8;
/// The six tetrahedra of a cell around its diagonal.
const TETRAHEDRA: [[usize; 4]; 6] = [
    [0, 4, 6, 7],
    [0, 4, 5, 7],
    [0, 2, 6, 7],
    [0, 2, 3, 7],
    [0, 1, 5, 7],
    [0, 1, 3, 7],
];

/// Measures the radii of the narrowest cavities again, which are the first `MAX_REFINED` of `list`. Those of points on
/// lattice edges are never less. Radii are in world units; those of 0 or of the reach or more stay. An escape radius is
/// at most the radius.
pub(super) fn refine<S: LeafSource>(
    source: &S,
    measure: Measure,
    list: &mut [Cavity],
    task: Task<'_>,
) -> Result<(), S::Error> {
    let count = list.len().min(MAX_REFINED);
    let refined = |place: Coord, radius: f64| -> Result<f64, S::Error> {
        let voxels = radius / measure.voxel_size;
        if voxels <= 0.0 || voxels >= f64::from(measure.reach) {
            return Ok(radius);
        }
        Ok(distance(source, measure, place, voxels)? * measure.voxel_size)
    };
    task.threads.install(|| {
        list[..count].par_iter_mut().try_for_each(|c| {
            c.radius = refined(c.place, c.radius)?;
            if let Some(throat) = c.throat {
                c.escape_radius = refined(throat, c.escape_radius)?.min(c.radius);
            }
            Ok::<(), S::Error>(())
        })
    })
}

/// Distance of a voxel from the surface, voxels, which is at most `most`. `most` is a distance that is known to be no
/// less, voxels.
fn distance<S: LeafSource>(
    source: &S,
    measure: Measure,
    voxel: Coord,
    most: f64,
) -> Result<f64, S::Error> {
    let reach = most.ceil() as i32 + 1;
    let region = Region::cube(voxel, 1).grown(reach);
    let Some(values) = DenseValues::read(source, region, measure.background)? else {
        return Ok(most);
    };
    // The least squared distance to the surface in the cells of the lattice around the voxel. In a cell the surface is
    // that of the linear function in each of its tetrahedra.
    let mut least = most * most;
    // The centre of a cell is at most half its diagonal, 0.87 rounded up, from the surface in it.
    let limit = (most + 0.87).powi(2);
    for x in -reach..reach {
        for y in -reach..reach {
            for z in -reach..reach {
                let centre = Vec3::new(x.into(), y.into(), z.into()).add_scalar(0.5);
                if centre.norm_squared() > limit {
                    continue;
                }
                let corner = |n: usize| {
                    let bit = |b: usize| (n >> b & 1) as i32;
                    [x + bit(2), y + bit(1), z + bit(0)]
                };
                let value: [f32; CORNERS] = std::array::from_fn(|n| {
                    let [x, y, z] = corner(n);
                    values.at(voxel.offset(x, y, z))
                });
                let inside = value.iter().filter(|v| **v < 0.0).count();
                if inside == 0 || inside == CORNERS {
                    continue;
                }
                let places: [Vec3; CORNERS] =
                    std::array::from_fn(|n| Vec3::from(corner(n).map(f64::from)));
                for tetrahedron in TETRAHEDRA {
                    least = least.min(square_to_section(&tetrahedron, &value, &places));
                }
            }
        }
    }
    Ok(least.sqrt())
}

/// Squared distance of the origin from the surface in a tetrahedron; infinite without any.
fn square_to_section(
    tetrahedron: &[usize; 4],
    value: &[f32; CORNERS],
    places: &[Vec3; CORNERS],
) -> f64 {
    let (inside, outside): (Vec<usize>, Vec<usize>) =
        tetrahedron.iter().copied().partition(|n| value[*n] < 0.0);
    // On the edge from a to b the linear function is 0 at the share |va| / (|va| + |vb|): three zeros or four.
    let crossing = |a: usize, b: usize| {
        let [va, vb] = [a, b].map(|n| f64::from(value[n].abs()));
        places[a] + (places[b] - places[a]) * (va / (va + vb))
    };
    let square = |triangle: [Vec3; 3]| closest_point(&triangle, Vec3::zeros()).norm_squared();
    match (&inside[..], &outside[..]) {
        ([a], [b, c, d]) | ([b, c, d], [a]) => square([b, c, d].map(|n| crossing(*a, *n))),
        ([a, b], [c, d]) => {
            let corners = [(*a, *c), (*a, *d), (*b, *d), (*b, *c)].map(|(n, m)| crossing(n, m));
            let [p, q, r, s] = corners;
            square([p, q, r]).min(square([p, r, s]))
        }
        _ => f64::INFINITY,
    }
}
