//! Weights of several methods whose weighted mean is nearest to the truth.

/// Names of the methods.
pub(super) const METHODS: [&str; 4] = ["linear", "quadratic", "gaussian-process", "extra-trees"];

/// Number of steps in which the weights are found.
const STEPS: usize = 400;

/// Weights from 0 to 1 with sum 1.
#[derive(Clone, Copy, Debug)]
pub(super) struct MethodWeights {
    weights: [f64; METHODS.len()],
}

impl MethodWeights {
    /// Returns the weights with the least squared error, from answers and true values. Each step moves toward one method by the best
    /// length (Frank and Wolfe 1956).
    pub(super) fn of(rows: impl Iterator<Item = ([f64; METHODS.len()], f64)>) -> MethodWeights {
        const N: usize = METHODS.len();
        // products of the methods' errors
        let mut products = [[0.0; N]; N];
        for (answers, truth) in rows {
            let errors = answers.map(|answer| answer - truth);
            for (i, row) in products.iter_mut().enumerate() {
                row.iter_mut().zip(errors).for_each(|(product, error)| *product += errors[i] * error);
            }
        }
        let best = (1..N).fold(0, |best, i| if products[i][i] < products[best][best] { i } else { best });
        let mut weights = [0.0; N];
        weights[best] = 1.0;
        let of = |a: &[f64; N], b: &[f64; N]| -> f64 {
            (0..N).map(|i| a[i] * (0..N).map(|j| products[i][j] * b[j]).sum::<f64>()).sum()
        };
        for _ in 0..STEPS {
            let gradient = |i: usize| (0..N).map(|j| products[i][j] * weights[j]).sum::<f64>();
            let toward = (1..N).fold(0, |least, i| if gradient(i) < gradient(least) { i } else { least });
            let way: [f64; N] = std::array::from_fn(|i| f64::from(u8::from(i == toward)) - weights[i]);
            let (slope, bend) = (of(&way, &weights), of(&way, &way));
            let is_downhill = slope < 0.0 && bend > 0.0;
            if !is_downhill {
                break;
            }
            let step = (-slope / bend).min(1.0);
            (0..N).for_each(|i| weights[i] += step * way[i]);
        }
        MethodWeights { weights }
    }

    /// Returns the weighted mean.
    pub(super) fn of_answers(&self, answers: [f64; METHODS.len()]) -> f64 {
        self.weights.iter().zip(answers).map(|(weight, answer)| weight * answer).sum()
    }
}
