//! Elimination for square matrices of any static size.
//!
//! nalgebra's `lu` needs `DimMin`, which a function generic over `N` can only satisfy with a
//! `where` clause in its signature and in every caller's; its `try_inverse` does not, but takes
//! four times as long.

use nalgebra::SMatrix;

/// `A^-1`, or `None` if a pivot is zero or not finite. Gauss-Jordan elimination in place, by
/// columns because columns are contiguous, with partial pivoting.
pub(super) fn inverse<const N: usize>(mut a: SMatrix<f64, N, N>) -> Option<SMatrix<f64, N, N>> {
    let mut swaps = [0; N];
    for i in 0..N {
        let columns = &mut a.data.0;
        let mut pivot = i;
        for column in i + 1..N {
            if columns[column][i].abs() > columns[pivot][i].abs() {
                pivot = column;
            }
        }
        swaps[i] = pivot;
        columns.swap(i, pivot);
        let reciprocal = 1.0 / columns[i][i];
        if !reciprocal.is_finite() {
            return None;
        }
        let mut pivot_column = columns[i].map(|x| x * reciprocal);
        pivot_column[i] = reciprocal;
        for column in columns.iter_mut() {
            let factor = column[i];
            for row in 0..N {
                column[row] -= pivot_column[row] * factor;
            }
            column[i] = -reciprocal * factor;
        }
        columns[i] = pivot_column;
    }
    for (i, &pivot) in swaps.iter().enumerate().rev() {
        a.swap_rows(i, pivot);
    }
    Some(a)
}

/// `log2 |det [a b; c d]|`, -infinity where it vanishes.
pub(super) fn log2_determinant<const N: usize>(blocks: [[&SMatrix<f64, N, N>; 2]; 2]) -> f64 {
    let mut columns: [[[[f64; N]; 2]; N]; 2] = std::array::from_fn(|right| {
        std::array::from_fn(|column| {
            std::array::from_fn(|lower| blocks[lower][right].data.0[column])
        })
    });
    let columns = columns.as_flattened_mut();
    let mut sum = 0.0;
    for i in 0..2 * N {
        let (done, rest) = columns.split_at_mut(i + 1);
        let pivot_column = done[i].as_flattened_mut();
        let mut pivot = i;
        for row in i + 1..2 * N {
            if pivot_column[row].abs() > pivot_column[pivot].abs() {
                pivot = row;
            }
        }
        pivot_column.swap(i, pivot);
        sum += pivot_column[i].abs().log2();
        let reciprocal = 1.0 / pivot_column[i];
        for column in rest {
            let column = column.as_flattened_mut();
            column.swap(i, pivot);
            let factor = column[i] * reciprocal;
            for row in i + 1..2 * N {
                column[row] -= pivot_column[row] * factor;
            }
        }
    }
    sum
}
