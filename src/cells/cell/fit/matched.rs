//! Cells of several elements that agree on the faces that the elements share.
//!
//! For each element of a mixed mesh, a cell is fitted to the given cell of that element. All are fitted
//! jointly: the sum of the mean squares of the differences, in edge lengths, is minimal among the functions
//! whose traces on triangles and squares are equal and have the full symmetry of the face (see
//! [`super::super::face_trace`]). Wedges and pyramids need this even among themselves, since their own
//! symmetries do not make a side independent of the orientation of the neighbour.

use super::super::domain::Domain;
use super::super::{Constraint, compatibility, face_normal, face_trace, symmetry};
use super::sampling::{parts_per_edge, quadrature_points};
use super::solve::{NormalEquations, Sample};
use super::{FitError, FitOptions, FitReport};
use crate::cell::{Cell, CellError, Series};
use crate::symmetry::Basis;
use druse_geometry::field::Field;
use druse_geometry::frame::{CellPoint, Element};
use druse_geometry::progress::Progress;

/// Maximal total number of unknowns of all elements.
const MAX_UNKNOWNS: usize = 4000;

/// Cells that agree on shared faces, each as close as possible to the given cell of its element. Their
/// fields are in edge lengths; `options.band_limit` is in cycles per edge. `rms` in the report is the
/// difference from the given cell.
/// The result is in the order of the cells. Only the default group and lattice of each element are used.
///
/// # Errors
/// [`FitError::Cell`] for planar cells and the ball, cells of different kinds of solid, and a result without a surface;
/// [`FitError::TooLarge`], [`FitError::Singular`], [`FitError::Cancelled`].
pub fn fit_matched(
    cells: &[Cell],
    options: &FitOptions,
    progress: &dyn Progress,
) -> Result<Vec<Cell>, FitError> {
    let fail = |what: &str| {
        let text = format!("cells of a mixed mesh {what}");
        Err(FitError::Cell(CellError::Expression(text)))
    };
    let Some(first) = cells.first() else {
        return Ok(Vec::new());
    };
    if cells.iter().any(|c| c.element().dimension() != 3) {
        return fail("must be three-dimensional; found a planar one");
    }
    if cells.iter().any(|c| c.solid() != first.solid()) {
        return fail("must be solid on the same side of the level; found both sides");
    }
    let mut bases = Vec::new();
    for cell in cells {
        let element = cell.element();
        // Waves of odd order on a triangle reach its edges only with frequencies up to sqrt(band_limit^2 + 1/3)
        // cycles per edge.
        let on_square = element == Element::Hex;
        let least = if on_square { 0.0 } else { 1.0 / 3.0 };
        let radius = (options.band_limit.powi(2) + least).sqrt() / element.edge();
        let (group, lattice) = symmetry::<3>(element, None, None)?;
        // The ball holds about this many frequencies; most orbits have as many members as the group. It is an estimate,
        // so that only twice the limit is refused before the frequencies are listed.
        let ball = std::f64::consts::PI * 4.0 / 3.0 * radius.powi(3) * lattice.volume();
        if ball / group.order() as f64 > 2.0 * MAX_UNKNOWNS as f64 {
            return Err(too_large(options.band_limit, ball as usize / group.order()));
        }
        bases.push((element, Basis::new(group, lattice, radius)));
    }
    let unknowns = bases.iter().map(|(_, b)| b.len()).sum();
    if unknowns > MAX_UNKNOWNS {
        return Err(too_large(options.band_limit, unknowns));
    }
    progress.stage("fit: cells that agree on faces", None);
    let mut equations = Vec::new();
    let mut samples = Vec::new();
    // Normal equations of each cell by itself; the traces couple them afterwards.
    for (cell, (element, basis)) in cells.iter().zip(&bases) {
        let (own, interior) = targets(cell, *element, basis, options);
        let lambda = options.lambda();
        equations.push(NormalEquations::assemble(basis, &own, lambda, progress)?);
        samples.push((own, interior));
    }
    let mut constraint = face_trace::equations(&bases);
    if options.face_normal {
        let own = bases.iter().map(|(e, b)| face_normal::equations(b, *e));
        constraint = constraint.and(&Constraint::block_diagonal(&own.collect::<Vec<_>>()));
    }
    let real = NormalEquations::joined(equations).solve(Some(&constraint))?;
    // Sheets, and channels, have one thickness, the mean: their middle functions agree, and so do their surfaces.
    let half = cells
        .iter()
        .map(|c| c.level() / field_units_per_edge(c))
        .sum::<f64>()
        / cells.len() as f64;
    let mut rest = &real[..];
    let mut matched = Vec::new();
    for ((cell, (element, basis)), (samples, interior)) in cells.iter().zip(&bases).zip(&samples) {
        let (own, tail) = rest.split_at(basis.len());
        rest = tail;
        let (group, lattice) = (basis.group().clone(), basis.lattice().clone());
        let series = Series::new(group, lattice, &basis.coefficients(own))?;
        let (mut sum, mut weight) = (0.0, 0.0);
        for s in &samples[..*interior] {
            sum += s.weight * (series.value(s.point) - s.value).powi(2);
            weight += s.weight;
        }
        let report = FitReport {
            method: "matched".to_owned(),
            solver: "dense".to_owned(),
            lattice: basis.lattice().name().unwrap_or_default().to_owned(),
            band_limit: basis.radius(),
            regularisation: options.lambda(),
            degrees_of_freedom: basis.len(),
            rms: (sum / weight).sqrt(),
            kept_energy: 1.0,
            face_normal_residual: face_normal::residual(&series, *element),
            ..FitReport::default()
        };
        let own = Cell::new(cell.name(), *element, series)?.with_face_normal(options.face_normal);
        let own = if cell.solid().is_symmetric() {
            own.with_solid(cell.solid(), half)?
        } else {
            own
        };
        own.check_surface()?;
        matched.push(own.with_report(report));
    }
    Ok(matched)
}

/// The error names the band limit that would have about 0.8 of the allowed unknowns; the number grows with its cube.
fn too_large(band_limit: f64, unknowns: usize) -> FitError {
    FitError::TooLarge {
        band_limit,
        unknowns,
        limit: MAX_UNKNOWNS,
        largest: band_limit * (MAX_UNKNOWNS as f64 * 0.8 / unknowns as f64).cbrt(),
    }
}

/// Units of a cell's field per edge length, on its surface.
fn field_units_per_edge(cell: &Cell) -> f64 {
    cell.gamma() * cell.element().edge()
}

/// Samples of a cell's function in edge lengths, negative inside (of a sheet, its middle function), and the
/// number of samples of the interior.
/// The samples of the interior come first, those of faces and edges follow.
fn targets(
    cell: &Cell,
    element: Element,
    basis: &Basis<3>,
    options: &FitOptions,
) -> (Vec<Sample<3>>, usize) {
    let domain = Domain::new(
        element,
        &compatibility::embedded(basis.group(), basis.lattice()),
    );
    let parts_per_edge = parts_per_edge(element, &domain, basis.len(), options.samples);
    let (quadrature_points, interior) =
        quadrature_points(element, &domain, parts_per_edge, options.weights());
    let scale = field_units_per_edge(cell).recip();
    // Phi of a sheet, not |Phi| - half: the middle function is smooth, and equal middles give equal sheets.
    let value = |p: CellPoint<3>| {
        if cell.solid().is_symmetric() {
            cell.expression().value(p)
        } else {
            Field::value(cell, p)
        }
    };
    let samples = quadrature_points.into_iter().map(|(point, weight)| Sample {
        point,
        value: value(point) * scale,
        weight,
    });
    (samples.collect(), interior)
}
