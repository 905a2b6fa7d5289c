//! Cells: symmetry of their properties, derivatives by their coefficients, threads, starts, refusals.

use super::difference;
use druse::cell::{Cell, FitOptions, Method, Series, Solid, Surface, fit, symmetry};
use druse::frame::{CellPoint, Element};
use druse::homogenize::{
    Conduction, Control, Elasticity, HomogenizeError, InitialSolutions, Packing, Period,
    Properties, Sensitivities, Settings, Voigt, by_coefficients, properties, properties_from,
    rotated,
};
use druse::progress::{Progress, Silent, Threads};
use nalgebra::{Matrix3, Rotation3, Unit, Vector3};

fn tight(all_loads: bool) -> Settings {
    Settings {
        permeability: false,
        all_loads,
        void: 1e-2,
        control: Control {
            tolerance: 1e-8,
            ..Control::default()
        },
        ..Settings::default()
    }
}

fn of(cell: Cell, packing: Packing, n: usize) -> Properties {
    let period = Period::of_cell(cell, packing).unwrap();
    let samples = period.samples(n, 2, &Silent).unwrap();
    properties(samples.grid(), &samples.shares(), &tight(true), &Silent).unwrap()
}

/// Whether a turn leaves a stiffness as it is.
fn is_kept(c: &Voigt, turn: &Matrix3<f64>) -> bool {
    difference(&rotated(c, turn), c) < 2e-6 * c[0][0]
}

#[test]
fn properties_have_the_symmetry_of_the_cell() {
    let quarter =
        *Rotation3::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2).matrix();
    let diagonal = Unit::new_normalize(Vector3::repeat(1.0));
    let third = *Rotation3::from_axis_angle(&diagonal, std::f64::consts::TAU / 3.0).matrix();
    // The hex' whole group, a half of it, and a surface whose own symmetry the cell does not know.
    for (surface, level) in [
        (Surface::SchwarzP, -0.3),
        (Surface::Iwp, 0.2),
        (Surface::Gyroid, -0.2),
    ] {
        let cell = surface.cell(Element::Hex).unwrap();
        let cell = cell.with_solid(Solid::Below, level).unwrap();
        let found = of(cell, Packing::Bcc, 16);
        let c = found.stiffness.unwrap();
        assert!(is_kept(&c, &third), "{surface:?} {c:?}");
        assert!(found.engineering.unwrap().off_cubic < 1e-6, "{surface:?}");
        let k = found.conductivity.unwrap();
        assert!(
            (k[0][0] - k[2][2]).abs() < 1e-6 && k[0][1].abs() < 1e-6,
            "{k:?}"
        );
        assert_eq!(found.load_cases, 6);
    }
    let tet = |level| {
        let cell = Surface::SchwarzP.cell(Element::Tet).unwrap();
        cell.with_solid(Solid::Above, level).unwrap()
    };
    let c = of(tet(0.3), Packing::Bcc, 16).stiffness.unwrap();
    assert!(is_kept(&c, &third) && is_kept(&c, &quarter), "{c:?}");
    let c = of(tet(0.3), Packing::Kuhn, 16).stiffness.unwrap();
    assert!(is_kept(&c, &third), "{c:?}");
    assert!(
        !is_kept(&c, &quarter),
        "six tets around a diagonal have no axis of order four"
    );
}

/// A gyroid in closed form with a wave that its group forbids: the fit under the group is as stiff as the gyroid.
#[test]
fn a_fit_under_the_space_group_of_the_gyroid_is_as_stiff() {
    let source = |p: CellPoint<3>| {
        let [x, y, z] = [p.0.x, p.0.y, p.0.z].map(|c| std::f64::consts::TAU * c);
        x.sin() * y.cos() + y.sin() * z.cos() + z.sin() * x.cos() + 0.2 * (x + z).cos()
    };
    let options = |group: &str| FitOptions {
        band_limit: 1.5,
        method: Method::Fft,
        measure: false,
        group: Some(group.to_owned()),
        ..FitOptions::default()
    };
    let gyroid = Surface::Gyroid.cell(Element::Hex).unwrap();
    let fitted = |group| fit("g", Element::Hex, &source, &options(group), &Silent).unwrap();
    let [exact, own, without] = [gyroid, fitted("I4132"), fitted("C1")].map(|cell| {
        let cell = cell.with_solid(Solid::Below, -0.3).unwrap();
        of(cell, Packing::Bcc, 16).stiffness.unwrap()
    });
    assert!(
        difference(&own, &exact) < 1e-6 * exact[0][0],
        "{own:?} {exact:?}"
    );
    assert!(difference(&without, &exact) > 1e-3 * exact[0][0]);
    // The lattice of another element beside that group is refused.
    for lattice in ["fcc2", "hexprism"] {
        let error = symmetry::<3>(Element::Hex, Some("I4132"), Some(lattice));
        let error = error.err().unwrap().to_string();
        assert!(
            error.contains(lattice) && error.contains("cubic"),
            "{error}"
        );
    }
}

#[test]
fn two_load_cases_are_enough_where_all_are_cubic() {
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let period = Period::of_cell(cell, Packing::Bcc).unwrap();
    let samples = period.samples(12, 2, &Silent).unwrap();
    let (grid, shares) = (samples.grid(), samples.shares());
    let few = properties(grid, &shares, &tight(false), &Silent).unwrap();
    let all = properties(grid, &shares, &tight(true), &Silent).unwrap();
    assert_eq!((few.load_cases, all.load_cases), (2, 6));
    assert!(difference(&few.stiffness.unwrap(), &all.stiffness.unwrap()) < 1e-7);
}

/// A cell of an element's whole group from its coefficients.
fn cell_of(element: Element, terms: &[([i32; 3], [f64; 2])]) -> Cell {
    let (group, lattice) = symmetry(element, None, Some("cubic")).unwrap();
    Cell::new("own", element, Series::new(group, lattice, terms).unwrap()).unwrap()
}

const TERMS: [([i32; 3], [f64; 2]); 4] = [
    ([1, 0, 0], [0.5, 0.0]),
    ([1, 1, 0], [0.05, 0.0]),
    ([1, 1, 1], [-0.04, 0.0]),
    ([2, 0, 0], [0.03, 0.0]),
];

/// C11, C12, C44, conductivity 11 and volume fraction.
fn numbers(found: &Properties) -> [f64; 5] {
    let c = found.stiffness.unwrap();
    let k = found.conductivity.unwrap();
    [c[0][0], c[0][1], c[3][3], k[0][0], found.volume_fraction]
}

fn derivatives_agree(make: &dyn Fn(&[f64]) -> Cell, packing: Packing, n: usize, values: &[f64]) {
    let settings = tight(true);
    let evaluated = |values: &[f64], start: Option<&mut InitialSolutions>| {
        let period = Period::of_cell(make(values), packing).unwrap();
        let samples = period.samples(n, 2, &Silent).unwrap();
        let (grid, shares) = (samples.grid(), samples.shares());
        let found = properties_from(grid, &shares, &settings, start, &Silent).unwrap();
        (period, samples, shares, found)
    };
    let mut start = InitialSolutions::default();
    let (period, samples, shares, found) = evaluated(values, Some(&mut start));
    let is_cut = |v: usize| shares[v] > 0.0 && shares[v] < 1.0;
    let void = settings.solid.scaled(settings.void);
    let (grid, scheme) = (samples.grid(), settings.scheme);
    let elastic = Elasticity::new(grid, &shares, settings.solid, void, scheme).unwrap();
    let thermal = Conduction::new(grid, &shares, 1.0, settings.void, scheme).unwrap();
    let sensitivities = Sensitivities {
        elastic: elastic.sensitivity(&start.displacements, &is_cut),
        thermal: thermal.sensitivity(&start.potentials, &is_cut),
    };
    let all = by_coefficients(&period, &samples, &sensitivities).unwrap();
    assert_eq!(all.len(), values.len(), "the level and every coefficient");
    let scale = numbers(&found).map(f64::abs);
    for (m, own) in all.iter().enumerate() {
        assert!(
            (own.value - values[m]).abs() < 1e-15,
            "{} {:?}",
            own.part,
            own.k
        );
        let h = 2e-4;
        let moved = |by: f64| {
            let mut values = values.to_vec();
            values[m] += by;
            numbers(&evaluated(&values, None).3)
        };
        let (above, below) = (moved(h), moved(-h));
        let c = &own.stiffness;
        let exact = [
            c[0][0],
            c[0][1],
            c[3][3],
            own.conductivity[0][0],
            own.volume_fraction,
        ];
        for i in 0..5 {
            let expected = (above[i] - below[i]) / (2.0 * h);
            let off = (exact[i] - expected).abs();
            assert!(
                off < 1e-5 * (expected.abs() + scale[i]),
                "{packing:?} {} {:?}, number {i}: {} {expected}",
                own.part,
                own.k,
                exact[i]
            );
        }
    }
}

#[test]
fn derivatives_by_level_and_coefficients_are_those_of_central_differences() {
    let with = |values: &[f64]| -> Vec<([i32; 3], [f64; 2])> {
        let terms = TERMS.iter().zip(&values[1..]);
        terms.map(|((k, _), v)| (*k, [*v, 0.0])).collect()
    };
    let values = |level: f64| -> Vec<f64> {
        std::iter::once(level)
            .chain(TERMS.iter().map(|t| t.1[0]))
            .collect()
    };
    let network = |v: &[f64]| {
        let cell = cell_of(Element::Hex, &with(v));
        cell.with_solid(Solid::Below, v[0]).unwrap()
    };
    derivatives_agree(&network, Packing::Bcc, 8, &values(-0.11));
    let sheet = |v: &[f64]| {
        let cell = cell_of(Element::Hex, &with(v));
        cell.with_solid(Solid::Sheet, v[0]).unwrap()
    };
    derivatives_agree(&sheet, Packing::Bcc, 8, &values(0.31));
    // In a tet k and -k of (1, 1, 1) are apart, so that its coefficient is complex.
    let tet = |v: &[f64]| {
        let mut terms = with(&[v[0], v[1], v[2], v[3], v[5]]);
        terms[2].1[1] = v[4];
        let cell = cell_of(Element::Tet, &terms);
        cell.with_solid(Solid::Above, v[0]).unwrap()
    };
    let mut own = values(0.17);
    own.insert(4, 0.025);
    derivatives_agree(&tet, Packing::Kuhn, 8, &own);
    if crate::is_full() {
        derivatives_agree(&tet, Packing::Bcc, 8, &own);
    }
}

#[test]
fn results_are_the_same_bytes_at_any_number_of_threads() {
    let cell = Surface::Diamond.cell(Element::Hex).unwrap();
    let period = Period::of_cell(cell, Packing::Bcc).unwrap();
    let run = |count: usize| {
        Threads::new(count).unwrap().install(|| {
            let samples = period.samples(16, 2, &Silent).unwrap();
            let settings = Settings {
                all_loads: true,
                ..Settings::default()
            };
            let found = properties(samples.grid(), &samples.shares(), &settings, &Silent);
            serde_json::to_string(&found.unwrap()).unwrap()
        })
    };
    let one = run(1);
    assert_eq!(one, run(2));
    assert_eq!(one, run(5));
}

#[test]
fn a_start_from_a_neighbour_ends_at_the_same_numbers_sooner() {
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let period = Period::of_cell(cell, Packing::Bcc).unwrap();
    let samples = period.samples(16, 2, &Silent).unwrap();
    let settings = tight(false);
    let mut start = InitialSolutions::default();
    let near = samples.clone().with_level(-0.02);
    let grid = samples.grid();
    properties_from(grid, &near.shares(), &settings, Some(&mut start), &Silent).unwrap();
    let shares = samples.shares();
    let warm = properties_from(grid, &shares, &settings, Some(&mut start), &Silent).unwrap();
    let cold = properties(grid, &shares, &settings, &Silent).unwrap();
    assert!(difference(&warm.stiffness.unwrap(), &cold.stiffness.unwrap()) < 1e-7);
    assert!(
        warm.iterations[0] < cold.iterations[0],
        "{:?} {:?}",
        warm.iterations,
        cold.iterations
    );
}

#[test]
fn levels_have_their_volume_fraction_and_phases_their_components() {
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let expected = cell.level_for_volume_fraction(0.35).unwrap();
    let period = Period::of_cell(cell, Packing::Bcc).unwrap();
    let samples = period.samples(32, 2, &Silent).unwrap();
    let level = samples.level_for_volume_fraction(0.35).unwrap();
    assert!((level - expected).abs() < 1e-3, "{level} {expected}");
    assert!(matches!(
        samples.level_for_volume_fraction(1.0),
        Err(HomogenizeError::Fraction(_))
    ));
    // Balls at the corners of cubes: no axis is passed along.
    let balls = samples.with_level(-2.0);
    let found = properties(balls.grid(), &balls.shares(), &tight(false), &Silent).unwrap();
    assert_eq!(
        (found.solid.components, found.solid.percolates),
        (1, [false; 3])
    );
    assert_eq!(
        (found.void.components, found.void.percolates),
        (1, [true; 3])
    );
}

#[test]
fn what_has_no_period_is_refused() {
    let surface = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let period = Period::of_cell(surface.clone(), Packing::Bcc).unwrap();
    assert!(period.samples(0, 2, &Silent).is_err());
    let (group, lattice) = symmetry(Element::Tet, Some("T"), Some("cubic")).unwrap();
    let series = Series::new(group, lattice, &[([1, 0, 0], [0.5, 0.0])]).unwrap();
    let lesser = Cell::new("lesser", Element::Tet, series).unwrap();
    assert!(matches!(
        Period::of_cell(lesser, Packing::Bcc),
        Err(HomogenizeError::Numbering { operators: 12, .. })
    ));
    let fine = cell_of(Element::Hex, &[([9, 0, 0], [0.5, 0.0])]);
    let period = Period::of_cell(fine, Packing::Bcc).unwrap();
    let refused = period.samples(16, 2, &Silent).unwrap_err().to_string();
    assert!(refused.contains("18 voxels"), "{refused}");
    for settings in [
        Settings {
            void: 1.0,
            ..tight(false)
        },
        Settings {
            void: -0.1,
            ..tight(false)
        },
        Settings {
            kappa: 0.0,
            ..tight(false)
        },
    ] {
        let samples = Period::of_cell(surface.clone(), Packing::Bcc).unwrap();
        let samples = samples.samples(8, 1, &Silent).unwrap();
        let refused = properties(samples.grid(), &samples.shares(), &settings, &Silent);
        assert!(matches!(refused, Err(HomogenizeError::Material { .. })));
    }
    let grid = period.grid(4).unwrap();
    assert!(properties(grid, &[0.5; 63], &tight(false), &Silent).is_err());
    assert!(properties(grid, &[1.5; 64], &tight(false), &Silent).is_err());
    assert!(druse::homogenize::Isotropic::new(1.0, 0.5).is_err());
    assert!(druse::homogenize::Isotropic::new(-1.0, 0.2).is_err());
    let all_open = properties(grid, &[0.0; 64], &Settings::default(), &Silent);
    assert!(matches!(all_open, Err(HomogenizeError::NoWalls)));
}

#[test]
fn cancelling_ends_at_once() {
    struct Stopped;
    impl Progress for Stopped {
        fn stage(&self, _: &str, _: Option<u64>) {}
        fn advance(&self, _: u64) {}
        fn cancelled(&self) -> bool {
            true
        }
    }
    let cell = Surface::SchwarzP.cell(Element::Hex).unwrap();
    let period = Period::of_cell(cell, Packing::Bcc).unwrap();
    assert!(matches!(
        period.samples(16, 2, &Stopped),
        Err(HomogenizeError::Cancelled(_))
    ));
    let samples = period.samples(16, 2, &Silent).unwrap();
    for permeability in [false, true] {
        let settings = Settings {
            permeability,
            stiffness: !permeability,
            conductivity: false,
            ..Settings::default()
        };
        let stopped = properties(samples.grid(), &samples.shares(), &settings, &Stopped);
        assert!(matches!(stopped, Err(HomogenizeError::Cancelled(_))));
    }
}
