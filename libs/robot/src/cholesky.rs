//! Cholesky's method for the small symmetric positive definite systems of a robot and its surroundings.

// Indices read as the algebra does.
#![allow(clippy::needless_range_loop)]

/// Factors the upper left `n` rows and columns in place; returns `false` if the matrix is not positive definite.
///
/// Reads and replaces the lower triangle alone. The diagonal of the factor holds reciprocals.
#[must_use]
pub fn factor<const WIDTH: usize>(m: &mut [[f64; WIDTH]; WIDTH], n: usize) -> bool {
    for i in 0..n {
        let (above, rest) = m.split_at_mut(i);
        let row = &mut rest[0];
        for j in 0..i {
            let mut sum = row[j];
            for k in 0..j {
                sum -= row[k] * above[j][k];
            }
            row[j] = sum * above[j][j];
        }
        let mut sum = row[i];
        for k in 0..i {
            sum -= row[k] * row[k];
        }
        if sum <= 0.0 || !sum.is_finite() {
            return false;
        }
        row[i] = 1.0 / sum.sqrt();
    }
    true
}

/// Solves with a factor from [`factor`]; replaces the right side in `x` by the solution.
pub fn substitute<const WIDTH: usize>(m: &[[f64; WIDTH]; WIDTH], x: &mut [f64; WIDTH], n: usize) {
    for i in 0..n {
        let row = &m[i];
        let mut sum = x[i];
        for k in 0..i {
            sum -= row[k] * x[k];
        }
        x[i] = sum * row[i];
    }
    for i in (0..n).rev() {
        let row = &m[i];
        let value = x[i] * row[i];
        x[i] = value;
        for k in 0..i {
            x[k] -= row[k] * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn cholesky_factored_matrix_solves() {
        let matrix = [[4.0, f64::NAN, f64::NAN], [2.0, 5.0, f64::NAN], [-1.0, 0.5, 3.0]];
        let solution = [0.3, -1.2, 2.0];
        let mut x = [0.0; 3];
        for i in 0..3 {
            for j in 0..3 {
                x[i] += if j <= i { matrix[i][j] } else { matrix[j][i] } * solution[j];
            }
        }
        let mut factored = matrix;
        assert!(factor(&mut factored, 3), "the upper triangle must not be read");
        substitute(&factored, &mut x, 3);
        for i in 0..3 {
            assert!((x[i] - solution[i]).abs() < 1e-14, "{x:?}");
        }
    }

    #[test]
    fn cholesky_indefinite_matrix_is_rejected() {
        assert!(!factor(&mut [[1.0, 0.0], [2.0, 1.0]], 2));
        assert!(!factor(&mut [[f64::NAN, 0.0], [0.0, 1.0]], 2));
    }
}
