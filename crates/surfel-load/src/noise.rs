//! Detection of noise and withheld points by their class and flag, and of water, whose sparse points aren't outliers.

use crate::LoadOptions;
use crate::words::counted;
use surfel_model::{Classes, CloudData, ExtraColumn, OnInvalid, SplatCloud};

/// Numbers of the ASPRS classes for low and high noise.
const NOISE: [f64; 2] = [7.0, 18.0];
/// Number of the ASPRS class for water.
const WATER: f64 = 9.0;

/// Points of a file that aren't part of a surface, by their class or flag.
pub(crate) struct NoisePoints {
    /// One flag per point, true for noise and withheld points.
    pub(crate) flags: Vec<bool>,
    noise: u64,
    withheld: u64,
}

/// Finds noise and withheld points; returns `None` if there are none. Noise is ignored if `classes` lists classes to
/// draw or is `all`, or if `condition` names the class; withheld points are ignored if `classes` is `all`.
pub(crate) fn noise_points(extras: &[ExtraColumn], count: usize, options: &LoadOptions) -> Option<NoisePoints> {
    let NoiseCriteria { by_class, by_flag } = NoiseCriteria::new(options);
    let class = ExtraColumn::find(extras, "classification").map(|e| &e.values).filter(|_| by_class);
    let flag = ExtraColumn::find(extras, "withheld").map(|e| &e.values).filter(|_| by_flag);
    let is_noise = |i: usize| class.is_some_and(|class| NOISE.contains(&class.get(i)));
    let is_withheld = |i: usize| flag.is_some_and(|flag| flag.get(i) != 0.0);
    let mut found = NoisePoints { flags: vec![false; count], noise: 0, withheld: 0 };
    for i in (0..count).filter(|_| class.is_some() || flag.is_some()) {
        let (noise, withheld) = (is_noise(i), is_withheld(i));
        found.flags[i] = noise || withheld;
        found.noise += u64::from(noise);
        found.withheld += u64::from(withheld && !noise);
    }
    (found.noise + found.withheld > 0).then_some(found)
}

impl NoisePoints {
    /// Describes the points for a note: "12 points of noise (classes 7 and 18)".
    pub(crate) fn words(&self) -> String {
        let noise = (self.noise > 0).then(|| format!("{} of noise (classes 7 and 18)", counted(self.noise, "points")));
        let withheld = (self.withheld > 0).then(|| format!("{} flagged as withheld", counted(self.withheld, "points")));
        noise.into_iter().chain(withheld).collect::<Vec<_>>().join(" and ")
    }
}

/// Criteria by which points count as noise or withheld: by their class, or by their flag in the file.
struct NoiseCriteria {
    by_class: bool,
    by_flag: bool,
}

impl NoiseCriteria {
    fn new(options: &LoadOptions) -> Self {
        // A condition on the class may select noise on purpose, so that noise isn't removed then.
        let names_class =
            options.convert.condition.as_ref().is_some_and(|text| text.to_ascii_lowercase().contains("class"));
        let are_named = matches!(options.convert.classes, Some(Classes::All | Classes::Only(_)));
        Self { by_class: !are_named && !names_class, by_flag: options.convert.classes != Some(Classes::All) }
    }
}

/// Returns one flag per point, true for water (class 9); `None` if no point is water.
pub fn water(extras: &[ExtraColumn], count: usize) -> Option<Vec<bool>> {
    let class = &ExtraColumn::find(extras, "classification")?.values;
    let flags: Vec<bool> = (0..count).map(|i| class.get(i) == WATER).collect();
    flags.contains(&true).then_some(flags)
}

/// Returns a cloud without noise and withheld points, and without attributes. Returns `None` if the cloud has no noise
/// or withheld points, or consists of them alone.
pub(crate) fn surface_of(cloud: &SplatCloud) -> Option<SplatCloud> {
    let all = cloud.data();
    let found = noise_points(&all.extras, cloud.len(), &LoadOptions::default())?;
    let mut data = CloudData {
        colors: all.colors.clone(),
        clips: all.clips.clone(),
        oriented: all.oriented,
        up: all.up,
        ..CloudData::new(all.origin, all.centers.clone(), all.shape.clone())
    };
    data.retain(&found.flags.iter().map(|flag| !flag).collect::<Vec<_>>());
    SplatCloud::new(data, OnInvalid::Refuse).ok().map(|(cloud, _)| cloud).filter(|cloud| !cloud.is_empty())
}

#[cfg(test)]
mod tests {
    use super::*;
    use surfel_model::{ConvertOptions, ExtraValues};

    fn extras() -> Vec<ExtraColumn> {
        let column = |name: &str, values: Vec<u8>| ExtraColumn { name: name.into(), values: ExtraValues::U8(values) };
        vec![column("Classification", vec![2, 7, 18, 9, 7, 2]), column("withheld", vec![0, 0, 0, 0, 1, 1])]
    }

    #[test]
    fn noise_and_withheld_points_are_no_surface_unless_they_are_chosen() {
        let options = |convert: ConvertOptions| LoadOptions { convert, ..LoadOptions::default() };
        let all = LoadOptions::default();
        let found = noise_points(&extras(), 6, &all).unwrap();
        assert_eq!(found.flags, [false, true, true, false, true, true]);
        assert_eq!(found.words(), "3 points of noise (classes 7 and 18) and 1 point flagged as withheld");
        assert!(noise_points(&extras()[..0], 6, &all).is_none());
        let flags = |text: &str| {
            let classes = Some(text.parse().unwrap());
            let options = options(ConvertOptions { classes, ..ConvertOptions::default() });
            noise_points(&extras(), 6, &options).map(|found| found.flags)
        };
        assert_eq!(flags("all"), None);
        assert_eq!(flags("2,7").unwrap(), [false, false, false, false, true, true]);
        assert_eq!(flags("!2").unwrap(), [false, true, true, false, true, true]);
        let condition = Some("Classification = 7".into());
        let named = options(ConvertOptions { condition, ..ConvertOptions::default() });
        assert_eq!(noise_points(&extras(), 6, &named).unwrap().words(), "2 points flagged as withheld");
        assert_eq!(water(&extras(), 6).unwrap(), [false, false, false, true, false, false]);
    }
}
