//! Loops compiled twice, for any processor and for one with wide vectors, and chosen at run time.
//!
//! Nothing is fused and no sum is reordered by it: both give the same bits.

/// Values that are computed side by side: as many as the widest vectors hold.
pub const LANES: usize = 8;
/// A value for each lane.
pub type Lanes = [f64; LANES];

/// A computation whose loops are worth wide vectors. Only what is inlined into `run` is compiled for them: its functions
/// and closures are `#[inline(always)]`.
pub trait Wide {
    /// What it gives.
    type Output;

    /// Computes it.
    fn run(self) -> Self::Output;
}

struct Call<T>(T);

impl<T: Wide> pulp::NullaryFnOnce for Call<T> {
    type Output = T::Output;

    #[inline(always)]
    fn call(self) -> T::Output {
        self.0.run()
    }
}

/// Computes with the widest vectors there are.
pub fn wide<T: Wide>(task: T) -> T::Output {
    pulp::Arch::new().dispatch(Call(task))
}

#[cfg(test)]
mod tests {
    use super::*;

    struct Sum<'a>(&'a [f64]);

    impl Wide for Sum<'_> {
        type Output = f64;

        #[inline(always)]
        fn run(self) -> f64 {
            self.0.iter().map(|x| x * x + 1.0).sum()
        }
    }

    #[test]
    fn wide_vectors_change_no_bit() {
        let numbers: Vec<f64> = (0..1000).map(|k| (f64::from(k) * 0.37).sin()).collect();
        assert_eq!(wide(Sum(&numbers)).to_bits(), Sum(&numbers).run().to_bits());
    }
}
