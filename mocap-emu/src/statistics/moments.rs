//! Standard deviation and correlation.

/// Standard deviation of `values`; 0 for fewer than two.
pub fn deviation(values: &[f64]) -> f64 {
    let count = values.len().max(1) as f64;
    let mean = values.iter().sum::<f64>() / count;
    (values.iter().map(|value| (value - mean).powi(2)).sum::<f64>() / count).sqrt()
}

/// Correlation of two series of equal length \[-\]; 0 if one of them is constant.
pub fn correlation(a: &[f64], b: &[f64]) -> f64 {
    let count = a.len().max(1) as f64;
    let (mean_a, mean_b) = (a.iter().sum::<f64>() / count, b.iter().sum::<f64>() / count);
    let products = a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b));
    let scale = deviation(a) * deviation(b);
    if scale > 0.0 { products.sum::<f64>() / count / scale } else { 0.0 }
}
