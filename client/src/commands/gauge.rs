//! Telling, in percent, how far a ranking is, where its table is not shown.

use crate::{error::ClientError, follow::Watcher, ui::tell_share};
use indicatif::ProgressBar;
use quadmuse_proto::{Event, Ranking};

/// The side of the picture before the coarsest level: where the share of a segment begins.
const BEFORE_FIRST: f64 = 16.0;

/// Shows on a sign of life how far a query is, and hands its events on.
pub(super) struct Gauge<'a> {
    spinner: ProgressBar,
    what: &'static str,
    /// How far each segment is, 0–1.
    shares: Vec<f64>,
    inner: Option<&'a mut dyn Watcher>,
}

impl<'a> Gauge<'a> {
    pub(super) fn new(spinner: ProgressBar, what: &'static str, inner: Option<&'a mut dyn Watcher>) -> Self {
        Self { spinner, what, shares: Vec::new(), inner }
    }
}

/// How far the ranking of a segment is, 0–1: levels double, from 32.
fn share(ranking: &Ranking) -> f64 {
    let steps = |side: u32| (f64::from(side) / BEFORE_FIRST).log2().max(0.0);
    let all = steps(ranking.resolution);
    if all > 0.0 { (steps(ranking.level) / all).min(1.0) } else { 1.0 }
}

impl Watcher for Gauge<'_> {
    fn see(&mut self, event: &Event) -> Result<(), ClientError> {
        match event {
            Event::Begin(begin) => self.shares = vec![0.0; begin.segments as usize],
            Event::Level(ranking) => {
                if let Some(known) = self.shares.get_mut(ranking.segment as usize) {
                    *known = share(ranking);
                }
                let all: f64 = self.shares.iter().sum();
                tell_share(&self.spinner, self.what, all / self.shares.len().max(1) as f64);
            }
            Event::End(_) | Event::Error(_) => {}
        }
        self.inner.as_mut().map_or(Ok(()), |inner| inner.see(event))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::table::tests::with_entries;
    use quadmuse_proto::Begin;

    #[test]
    fn levels_of_all_segments_count() {
        struct Seen(usize);
        impl Watcher for Seen {
            fn see(&mut self, _: &Event) -> Result<(), ClientError> {
                self.0 += 1;
                Ok(())
            }
        }
        let (spinner, mut seen) = (ProgressBar::hidden(), Seen(0));
        let mut gauge = Gauge::new(spinner.clone(), "ranking", Some(&mut seen));
        let query = with_entries(1).query;
        gauge.see(&Event::Begin(Begin { query, segments: 2, resolution: 128, corpus_size: 3 })).expect("sees");
        // Of 32, 64 and 128 a level each: a sixth of two segments.
        for (segment, level, percent) in [(0, 32, 16), (1, 64, 50), (0, 128, 83), (1, 128, 100)] {
            let ranking = Ranking { segment, level, resolution: 128, ..with_entries(1) };
            gauge.see(&Event::Level(ranking)).expect("sees");
            assert_eq!(spinner.position(), percent, "segment {segment}, level {level}");
        }
        assert_eq!(seen.0, 5);
    }
}
