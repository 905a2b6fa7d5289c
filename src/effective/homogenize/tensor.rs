//! Stiffness matrices in Voigt notation (11 22 33 23 13 12, engineering shear): inverses, rotations, constants.
//!
//! All functions are pure and keep the unit of the moduli. Engineering shear is twice the tensor's strain, so that the
//! energy is half the product of the six stresses and strains.

use druse_geometry::frame::Vec3;
use nalgebra::{Matrix3, Matrix6};

/// A symmetric 6x6 matrix over 11 22 33 23 13 12 with engineering shear strains.
pub type Voigt = [[f64; 6]; 6];

/// Places of the upper triangle of a [`Voigt`] matrix, row by row.
pub const PAIRS: [(usize, usize); 21] = {
    let mut all = [(0, 0); 21];
    let mut n = 0;
    let mut i = 0;
    while i < 6 {
        let mut j = i;
        while j < 6 {
            all[n] = (i, j);
            n += 1;
            j += 1;
        }
        i += 1;
    }
    all
};

/// The tensor indices of a Voigt component.
pub const fn symmetric_index(component: usize) -> (usize, usize) {
    [(0, 0), (1, 1), (2, 2), (1, 2), (0, 2), (0, 1)][component]
}

/// The mean of a matrix and its transpose: it removes the difference that a solver's residual leaves.
pub fn symmetrised(c: &Voigt) -> Voigt {
    std::array::from_fn(|i| std::array::from_fn(|j| f64::midpoint(c[i][j], c[j][i])))
}

/// The inverse of a stiffness matrix; `None` where it is singular.
pub fn compliance(c: &Voigt) -> Option<Voigt> {
    let m = Matrix6::from_fn(|i, j| c[i][j]);
    let s = m.try_inverse()?;
    s.iter().all(|v| v.is_finite()).then(|| {
        std::array::from_fn(|i| std::array::from_fn(|j| f64::midpoint(s[(i, j)], s[(j, i)])))
    })
}

/// Engineering constants of a stiffness, read as orthotropic.
#[derive(Clone, Copy, Debug, PartialEq, serde::Serialize)]
pub struct EngineeringConstants {
    /// Young's moduli along x, y, z.
    pub young: [f64; 3],
    /// Shear moduli 23, 13, 12.
    pub shear: [f64; 3],
    /// Poisson's ratios 12, 13, 23: minus the strain along the second axis over that along the first when
    /// pulled along the first.
    pub poisson: [f64; 3],
    /// Bulk modulus: mean stress over volume strain under uniform strain (Voigt's mean).
    pub bulk: f64,
    /// Bulk modulus under uniform stress (Reuss' mean); equal to the other for cubic symmetry.
    pub bulk_reuss: f64,
    /// Shear modulus, mean over all directions under uniform strain.
    pub shear_voigt: f64,
    /// Shear modulus, mean over all directions under uniform stress.
    pub shear_reuss: f64,
    /// Zener's ratio 2 C44 / (C11 - C12) with means over the axes: 1 if isotropic. It describes cubic symmetry only.
    pub zener: f64,
    /// Universal anisotropy (Ranganathan and Ostoja-Starzewski 2008): 0 if isotropic.
    pub anisotropy: f64,
    /// Largest difference to the cubic matrix of the same means, over the largest entry.
    pub off_cubic: f64,
}

/// Means over the axes: C11, C12, C44.
pub fn cubic_means(c: &Voigt) -> [f64; 3] {
    [
        (c[0][0] + c[1][1] + c[2][2]) / 3.0,
        (c[0][1] + c[0][2] + c[1][2]) / 3.0,
        (c[3][3] + c[4][4] + c[5][5]) / 3.0,
    ]
}

/// The constants of a stiffness; `None` where it is singular.
pub fn engineering(c: &Voigt) -> Option<EngineeringConstants> {
    // Voigt means take the stiffness, Reuss means the compliance, each averaged over all orientations.
    let s = compliance(c)?;
    let [c11, c12, c44] = cubic_means(c);
    let bulk = (c11 + 2.0 * c12) / 3.0;
    let bulk_reuss = 1.0 / (s[0][0] + s[1][1] + s[2][2] + 2.0 * (s[0][1] + s[0][2] + s[1][2]));
    let shear_voigt = (c11 - c12 + 3.0 * c44) / 5.0;
    let [s11, s12, s44] = cubic_means(&s);
    let shear_reuss = 5.0 / (4.0 * (s11 - s12) + 3.0 * s44);
    let greatest = c.iter().flatten().fold(0.0, |m: f64, v| m.max(v.abs()));
    // The deviation from the nearest cubic stiffness, relative to the greatest entry.
    let mut off_cubic = 0f64;
    for i in 0..6 {
        for j in 0..6 {
            let mean = match (i < 3, j < 3, i == j) {
                (true, true, true) => c11,
                (true, true, false) => c12,
                (false, false, true) => c44,
                _ => 0.0,
            };
            off_cubic = off_cubic.max((c[i][j] - mean).abs() / greatest);
        }
    }
    Some(EngineeringConstants {
        young: [0, 1, 2].map(|i| 1.0 / s[i][i]),
        shear: [3, 4, 5].map(|i| 1.0 / s[i][i]),
        poisson: [(0, 1), (0, 2), (1, 2)].map(|(i, j)| -s[i][j] / s[i][i]),
        bulk,
        bulk_reuss,
        shear_voigt,
        shear_reuss,
        zener: 2.0 * c44 / (c11 - c12),
        anisotropy: 5.0 * shear_voigt / shear_reuss + bulk / bulk_reuss - 6.0,
        off_cubic,
    })
}

/// Young's modulus along a direction of any length but 0, from the compliance: 1 / E(n) is n n : S : n n.
pub fn directional_modulus(compliance: &Voigt, direction: Vec3) -> f64 {
    let n = direction.normalize();
    let v = [
        n.x * n.x,
        n.y * n.y,
        n.z * n.z,
        n.y * n.z,
        n.x * n.z,
        n.x * n.y,
    ];
    let inverse: f64 = (0..6)
        .map(|i| v[i] * (0..6).map(|j| compliance[i][j] * v[j]).sum::<f64>())
        .sum();
    1.0 / inverse
}

/// The stiffness of the material after a rotation by an orthogonal matrix, which maps old directions to new ones.
pub fn rotated(c: &Voigt, turn: &Matrix3<f64>) -> Voigt {
    // Strains of the turned frame in the old one: Bond's matrix, column by column.
    let strain = |component: usize| -> [f64; 6] {
        let (i, j) = symmetric_index(component);
        let mut e = Matrix3::<f64>::zeros();
        e[(i, j)] += 0.5;
        e[(j, i)] += 0.5;
        let t = turn.transpose() * e * turn;
        std::array::from_fn(|m| {
            let (a, b) = symmetric_index(m);
            if a == b { t[(a, b)] } else { 2.0 * t[(a, b)] }
        })
    };
    let columns: [[f64; 6]; 6] = std::array::from_fn(strain);
    std::array::from_fn(|i| {
        std::array::from_fn(|j| {
            (0..6)
                .map(|m| columns[i][m] * (0..6).map(|n| c[m][n] * columns[j][n]).sum::<f64>())
                .sum()
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::homogenize::Isotropic;

    #[test]
    fn an_isotropic_material_has_its_constants_in_every_frame() {
        let c = Isotropic::new(3.0, 0.3).unwrap().stiffness();
        let e = engineering(&c).unwrap();
        for i in 0..3 {
            assert!((e.young[i] - 3.0).abs() < 1e-12);
            assert!((e.poisson[i] - 0.3).abs() < 1e-12);
            assert!((e.shear[i] - 3.0 / 2.6).abs() < 1e-12);
        }
        assert!((e.zener - 1.0).abs() < 1e-12 && e.anisotropy.abs() < 1e-12);
        assert!((e.bulk - 3.0 / (3.0 * 0.4)).abs() < 1e-12);
        let turn = *nalgebra::Rotation3::from_euler_angles(0.3, -0.7, 1.1).matrix();
        let turned = rotated(&c, &turn);
        for i in 0..6 {
            for j in 0..6 {
                assert!((turned[i][j] - c[i][j]).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn the_modulus_along_a_direction_is_that_of_the_turned_material() {
        let mut c = Isotropic::new(1.0, 0.2).unwrap().stiffness();
        c[3][3] *= 2.0;
        c[4][4] *= 1.5;
        c[0][0] *= 1.3;
        let turn = *nalgebra::Rotation3::from_euler_angles(0.4, 0.9, -0.2).matrix();
        let turned = rotated(&c, &turn);
        // The x axis of the turned frame is a column of the inverse turn.
        let n = turn.transpose() * Vec3::x();
        let along = directional_modulus(&compliance(&c).unwrap(), n);
        let expected = 1.0 / compliance(&turned).unwrap()[0][0];
        assert!((along - expected).abs() < 1e-12, "{along} {expected}");
    }
}
