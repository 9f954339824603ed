//! In which order a tour visits the boundary loops of a surface.
//!
//! Of a few loops every closed tour is tried, and the least of length · (1 + mismatch) taken. The mismatch tells how far a
//! tour is from its own mirror image: over the reflections ρ of its places, the least of
//! half of mean |d(i, j) − d(ρi, ρj)| / mean d + mean |g(i) − g(ρi)| / mean g, d the distances between loops, g their girths.
//! On a body whose left side is as its right, a tour that is no mirror image of itself has a rival that is just as short,
//! so that a trifle would decide between the two; one that is its own mirror image has none. Of many loops the tour is a
//! short one (insertion, then exchange of pairs). *Ours, not the paper's.*

/// Up to so many loops every tour is tried.
const TRIED_MAX: usize = 9;

/// The numbers of the loops in order; `between` holds the distances between loops, `girths` their lengths.
pub(super) fn order(between: &[Vec<f64>], girths: &[f64]) -> Vec<usize> {
    let n = girths.len();
    if n > TRIED_MAX {
        return short(between);
    }
    let loops = Loops::new(between, girths);
    let mut best = (f64::INFINITY, (0..n).collect::<Vec<usize>>());
    for_each_tour(&mut best.1.clone(), 1, &mut |tour| {
        let length = loops.length(tour);
        if length < best.0 {
            let cost = length * (1.0 + loops.mismatch(tour));
            // A tie goes to the first, whatever the rounding.
            if cost < best.0 * (1.0 - 1e-9) {
                best = (cost, tour.to_vec());
            }
        }
    });
    best.1
}

/// Calls `visit` with every tour that begins as `tour` does up to `fixed`, each in one of its two directions.
fn for_each_tour(tour: &mut Vec<usize>, fixed: usize, visit: &mut dyn FnMut(&[usize])) {
    let n = tour.len();
    if fixed >= n {
        if n < 3 || tour[1] < tour[n - 1] {
            visit(tour);
        }
        return;
    }
    for k in fixed..n {
        tour.swap(fixed, k);
        for_each_tour(tour, fixed + 1, visit);
        tour.swap(fixed, k);
    }
}

/// Loops, in units of their means.
struct Loops {
    /// Distances, the same both ways.
    between: Vec<Vec<f64>>,
    girths: Vec<f64>,
}

impl Loops {
    fn new(between: &[Vec<f64>], girths: &[f64]) -> Self {
        let n = girths.len();
        let mean = |a: usize, b: usize| 0.5 * (between[a][b] + between[b][a]);
        let mut between: Vec<Vec<f64>> = (0..n).map(|a| (0..n).map(|b| mean(a, b)).collect()).collect();
        let distance = between.iter().flatten().sum::<f64>() / (n * n).max(1) as f64;
        let girth = girths.iter().sum::<f64>() / n.max(1) as f64;
        between.iter_mut().flatten().for_each(|d| *d /= distance.max(f64::MIN_POSITIVE));
        Self { between, girths: girths.iter().map(|g| g / girth.max(f64::MIN_POSITIVE)).collect() }
    }

    fn length(&self, tour: &[usize]) -> f64 {
        (0..tour.len()).map(|k| self.between[tour[k]][tour[(k + 1) % tour.len()]]).sum()
    }

    /// How far a tour is from its own mirror image.
    fn mismatch(&self, tour: &[usize]) -> f64 {
        let n = tour.len();
        let about = |axis: usize| {
            let image = |k: usize| tour[(axis + n - k) % n];
            let mut sum = 0.0;
            for i in 0..n {
                let (a, b) = (tour[i], image(i));
                sum += (self.girths[a] - self.girths[b]).abs() / n as f64;
                let pair = |j: usize| (self.between[a][tour[j]] - self.between[b][image(j)]).abs();
                sum += (0..n).map(pair).sum::<f64>() / (n * n) as f64;
            }
            sum
        };
        0.5 * (0..n).map(about).fold(f64::INFINITY, f64::min)
    }
}

/// A short closed tour.
fn short(between: &[Vec<f64>]) -> Vec<usize> {
    let n = between.len();
    let mut tour = vec![0];
    while tour.len() < n {
        // The loop that is nearest to the tour is inserted where it costs least.
        let nearest = |k: &usize| tour.iter().map(|&t| between[t][*k]).fold(f64::INFINITY, f64::min);
        let rest = (0..n).filter(|k| !tour.contains(k));
        let Some(new) = rest.min_by(|a, b| nearest(a).total_cmp(&nearest(b))) else { break };
        let cost = |at: usize| {
            let (a, b) = (tour[at], tour[(at + 1) % tour.len()]);
            between[a][new] + between[new][b] - between[a][b]
        };
        let at = (0..tour.len()).min_by(|&a, &b| cost(a).total_cmp(&cost(b))).unwrap_or(0);
        tour.insert(at + 1, new);
    }
    let mut better = true;
    while std::mem::take(&mut better) {
        for i in 0..n.saturating_sub(1) {
            for j in i + 2..n {
                let (a, b, c, d) = (tour[i], tour[i + 1], tour[j], tour[(j + 1) % n]);
                let gain = between[a][b] + between[c][d] - between[a][c] - between[b][d];
                if a != d && gain > 1e-9 * between[a][b] {
                    tour[i + 1..=j].reverse();
                    better = true;
                }
            }
        }
    }
    tour
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Loops at places of the plane.
    fn distances(places: &[[f64; 2]]) -> Vec<Vec<f64>> {
        let between = |a: &[f64; 2], b: &[f64; 2]| (a[0] - b[0]).hypot(a[1] - b[1]);
        places.iter().map(|a| places.iter().map(|b| between(a, b)).collect()).collect()
    }

    /// Whether two loops follow each other.
    fn beside(tour: &[usize], a: usize, b: usize) -> bool {
        (0..tour.len()).any(|k| {
            let (x, y) = (tour[k], tour[(k + 1) % tour.len()]);
            (x, y) == (a, b) || (x, y) == (b, a)
        })
    }

    #[test]
    fn a_tour_around_a_circle_is_the_circle_for_few_and_for_many_loops() {
        for n in [1, 2, 3, 7, 12] {
            let place = |k: usize| (std::f64::consts::TAU * (5 * k % n) as f64 / n as f64).sin_cos();
            let places: Vec<[f64; 2]> = (0..n).map(|k| [place(k).0, place(k).1]).collect();
            let tour = order(&distances(&places), &vec![1.0; n]);
            let mut all = tour.clone();
            all.sort_unstable();
            assert_eq!(all, (0..n).collect::<Vec<_>>());
            let step =
                (0..n).map(|k| (5 * tour[k] % n).abs_diff(5 * tour[(k + 1) % n] % n)).all(|d| d <= 1 || d == n - 1);
            assert!(step, "{n}: {tour:?}");
        }
    }

    #[test]
    fn of_tours_about_as_short_the_one_that_is_its_own_mirror_image_is_taken() {
        // Neck, tail, and two pairs of legs; neck and tail are somewhat nearer to each other than the legs of a side.
        let [neck, tail, fl, fr, bl, br] = [0, 1, 2, 3, 4, 5];
        let mut between = vec![vec![0.9; 6]; 6];
        let mut set = |a: usize, b: usize, d: f64| (between[a][b], between[b][a]) = (d, d);
        (0..6).for_each(|k| set(k, k, 0.0));
        set(neck, tail, 0.80);
        [(fl, bl), (fr, br)].into_iter().for_each(|(a, b)| set(a, b, 0.85));
        [(neck, fl), (neck, fr), (tail, bl), (tail, br), (fl, fr), (bl, br)]
            .into_iter()
            .for_each(|(a, b)| set(a, b, 0.33));
        set(neck, fr, 0.34);
        let tour = order(&between, &[0.46, 0.16, 0.12, 0.12, 0.14, 0.14]);
        assert!(beside(&tour, fl, bl) && beside(&tour, fr, br), "{tour:?}");
        // The shortest alone would run from neck to tail, with one pair of legs crossed on either side.
        let shortest = 0.80 + 0.33 * 4.0 + 0.85;
        let taken: f64 = (0..6).map(|k| between[tour[k]][tour[(k + 1) % 6]]).sum();
        assert!(taken > shortest, "{taken} {shortest}");
    }
}
