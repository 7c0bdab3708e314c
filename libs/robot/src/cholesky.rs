//! Cholesky's method for the small symmetric positive definite systems of a robot and its surroundings.

// Indices read as the algebra does.
#![allow(clippy::needless_range_loop)]

/// Factors the upper left `n` rows and columns in place; returns `false` if the matrix is not positive definite.
///
/// Reads and replaces the lower triangle alone. The diagonal of the factor holds reciprocals.
#[must_use]
#[inline]
pub fn factor<const WIDTH: usize>(m: &mut [[f64; WIDTH]; WIDTH], n: usize) -> bool {
    for k in 0..n {
        let pivot = m[k][k];
        if pivot <= 0.0 || !pivot.is_finite() {
            return false;
        }
        let reciprocal = 1.0 / pivot.sqrt();
        m[k][k] = reciprocal;
        // What a column takes from those behind it goes at once: no entry waits for the sum before it.
        let mut column = [0.0; WIDTH];
        for i in k + 1..n {
            column[i] = m[i][k] * reciprocal;
        }
        for i in k + 1..n {
            m[i][k] = column[i];
            for j in k + 1..=i {
                m[i][j] -= column[i] * column[j];
            }
        }
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
