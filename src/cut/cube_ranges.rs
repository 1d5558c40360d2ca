//! Boxes of whole cubes in a list, and those of them that meet another box: a tree over runs of the list, whose neighbours lie
//! near each other.

use std::ops::ControlFlow;

/// So many boxes, or runs of boxes, are joined to one of the next level.
const RUN: usize = 16;

/// Whole cubes from one to another, both included.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct CubeRange {
    pub(super) low: [i64; 3],
    pub(super) high: [i64; 3],
}

impl CubeRange {
    /// Meets nothing.
    pub(super) const EMPTY: Self = Self { low: [i64::MAX; 3], high: [i64::MIN; 3] };

    fn meets(&self, other: &Self) -> bool {
        (0..3).all(|axis| self.low[axis] <= other.high[axis] && other.low[axis] <= self.high[axis])
    }

    fn joined(run: &[Self]) -> Self {
        run.iter().fold(Self::EMPTY, |mut all, range| {
            for axis in 0..3 {
                all.low[axis] = all.low[axis].min(range.low[axis]);
                all.high[axis] = all.high[axis].max(range.high[axis]);
            }
            all
        })
    }
}

/// A list of ranges, with joins of its runs, of runs of these and so on.
pub(super) struct CubeRanges {
    levels: Vec<Vec<CubeRange>>,
}

impl CubeRanges {
    pub(super) fn new(ranges: Vec<CubeRange>) -> Self {
        let mut levels = vec![ranges];
        while let Some(last) = levels.last().filter(|last| last.len() > RUN) {
            let joined = last.chunks(RUN).map(CubeRange::joined).collect();
            levels.push(joined);
        }
        Self { levels }
    }

    /// Numbers of the ranges that meet another one, ascending, until `each` breaks off.
    pub(super) fn visit(&self, range: &CubeRange, each: &mut impl FnMut(usize) -> ControlFlow<()>) {
        let top = self.levels.len() - 1;
        let _ = self.visit_run(top, 0..self.levels[top].len(), range, each);
    }

    fn visit_run(
        &self,
        level: usize,
        run: std::ops::Range<usize>,
        range: &CubeRange,
        each: &mut impl FnMut(usize) -> ControlFlow<()>,
    ) -> ControlFlow<()> {
        for at in run {
            if !self.levels[level][at].meets(range) {
                continue;
            }
            if level == 0 {
                each(at)?;
            } else {
                let end = ((at + 1) * RUN).min(self.levels[level - 1].len());
                self.visit_run(level - 1, at * RUN..end, range, each)?;
            }
        }
        ControlFlow::Continue(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_that_meet_are_visited_in_order() {
        let mut random = crate::splitmix::SplitMix::new(4);
        for count in [0, 1, 15, 16, 17, 300, 5000] {
            let range = |random: &mut crate::splitmix::SplitMix| {
                let low = [0; 3].map(|_| (random.next() % 40) as i64 - 20);
                let high = low.map(|low| low + (random.next() % 4) as i64);
                if random.next().is_multiple_of(9) { CubeRange::EMPTY } else { CubeRange { low, high } }
            };
            let list: Vec<CubeRange> = (0..count).map(|_| range(&mut random)).collect();
            let tree = CubeRanges::new(list.clone());
            for _ in 0..30 {
                let asked = range(&mut random);
                let expected: Vec<usize> = (0..count).filter(|&at| list[at].meets(&asked)).collect();
                let mut found = Vec::new();
                tree.visit(&asked, &mut |at| {
                    found.push(at);
                    ControlFlow::Continue(())
                });
                assert_eq!(found, expected);
                let mut first = None;
                tree.visit(&asked, &mut |at| {
                    first = Some(at);
                    ControlFlow::Break(())
                });
                assert_eq!(first, expected.first().copied());
            }
        }
    }
}
