//! Colour scales that are shared by all objects drawn together, one scale per attribute.

use super::tally::{Tally, words};
use super::{Attribute, ColorMap, ColorScale, Coloring, FileColors, Labels, paint};
use crate::{Error, LoadOptions};
use glam::{DAffine3, DVec3};
use std::collections::HashSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use surfel_framing::{UpConvention, upright};
use surfel_model::PointCloud;
use surfel_model::{Colormap, ExtraColumn, Geometry, Material, ModelError, Object, SplatCloud, Up};

/// Options for colouring by an attribute: colour map, names of categories, and range of values.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Colors {
    /// Colour map; `None` chooses one by the attribute and its values.
    pub(crate) map: Option<ColorMap>,
    /// Names and colours of categories, from the user's file; `None` without a file.
    pub(crate) labels: Option<Arc<Labels>>,
    /// Minimum and maximum of the colour map's range; `None` uses percentiles of the values.
    pub(crate) range: Option<[f64; 2]>,
}

impl Colors {
    /// True if the options are meant for categories: names of categories, or a colour map for categories.
    pub(crate) fn are_categories(&self) -> bool {
        self.labels.is_some() || self.map.as_ref().is_some_and(ColorMap::is_of_categories)
    }

    /// Returns the colouring options among loading options. Reads the files that they name.
    pub fn of(options: &LoadOptions) -> Result<Self, Error> {
        let file = options.convert.colormap_file.as_ref().map(|path| FileColors::read(path)).transpose()?;
        let named = options.convert.colormap.map(ColorMap::from);
        let labels = options.convert.labels.as_ref().map(|path| Labels::read(path)).transpose()?;
        let map = file.map(|colors| ColorMap::File(Arc::new(colors))).or(named);
        Ok(Self { map, labels: labels.map(Arc::new), range: options.convert.range })
    }
}

/// Request for colouring the splats of one file by an attribute.
#[derive(Clone, Debug)]
pub struct ColorJob {
    /// Path of the file whose splats are coloured.
    pub path: PathBuf,
    /// Attribute by which splats are coloured.
    pub attribute: String,
    /// Colour map, names of categories, and range of values.
    pub colors: Colors,
    /// Axis along which heights are measured. `None` if the file's up axis isn't certain; the files of a scene then
    /// share an axis.
    pub up: Option<Up>,
    /// Up axis that is usual for files of this kind, which the estimate of the axis for heights prefers.
    pub convention: UpConvention,
    /// Names of the mesh's attributes that may not have been transferred to splats, for the message about an unknown
    /// attribute.
    pub others: Vec<String>,
}

impl ColorJob {
    /// True if both requests have the same attribute and options, so that they share one scale.
    fn shares_scale(&self, other: &Self) -> bool {
        self.attribute.eq_ignore_ascii_case(&other.attribute) && self.colors == other.colors
    }
}

/// Colour scale of one attribute, and the files that share it.
#[derive(Clone, Debug)]
struct Scale {
    job: ColorJob,
    coloring: Coloring,
    note: String,
    /// Files that are coloured by the scale, in the order in which they were added.
    paths: Vec<PathBuf>,
}

/// Colour scales of all objects that are drawn together.
#[derive(Clone, Debug, Default)]
pub struct Colorings {
    scales: Vec<Scale>,
    /// Axis along which heights are measured for files whose own up axis isn't certain; `None` if it isn't needed or
    /// not determined yet.
    axis: Option<Up>,
}

/// Splats of one file for which a shared colour scale is determined.
pub struct Member<'a> {
    /// Request for colouring the splats.
    pub job: &'a ColorJob,
    /// Splats that are coloured.
    pub cloud: &'a mut Arc<SplatCloud>,
    /// True if the splats are already coloured and only contribute to the scale.
    pub is_colored: bool,
}

/// Report on a file that doesn't have the requested attribute. Its splats are coloured grey.
pub struct MissingAttribute {
    /// Index of the file's [`Member`] in the list that [`Tallies::add`] got.
    pub member: usize,
    /// Names of the attributes that the file has, for the message.
    pub known: Vec<String>,
}

impl Colorings {
    /// Returns the coloured files and their colourings.
    pub fn iter(&self) -> impl Iterator<Item = (&Path, &Coloring)> {
        self.scales.iter().flat_map(|scale| scale.paths.iter().map(|path| (path.as_path(), &scale.coloring)))
    }

    /// Returns the note about each scale, with the path of the first file that uses the scale.
    pub fn notes(&self) -> impl Iterator<Item = (&Path, &str)> {
        self.scales.iter().filter_map(|scale| Some((scale.paths.first()?.as_path(), scale.note.as_str())))
    }

    /// Determines one scale per attribute, and colours the members. Scales from earlier calls are preserved, and new
    /// categories are added to them. Returns the members whose files lack the attribute.
    pub(crate) fn color(&mut self, members: &mut [Member<'_>]) -> Result<Vec<MissingAttribute>, ModelError> {
        let mut tallies = Tallies { axis: self.axis, ..Tallies::default() };
        let lacking = tallies.add(members);
        self.axis = tallies.axis;
        let known = std::mem::take(&mut self.scales);
        self.scales = tallies.scales(&known);
        for member in members.iter_mut().filter(|member| !member.is_colored) {
            let data = member.cloud.data();
            let attribute = Attribute::of(&data.extras, data.colors.is_some(), &member.job.attribute).ok();
            let is_direct = attribute.is_some_and(|attribute| attribute.direct().is_some());
            let is_own = |scale: &&Scale| {
                scale.job.shares_scale(member.job) && (scale.coloring.scale == ColorScale::Direct) == is_direct
            };
            let scale = self.scales.iter().find(is_own).map_or(&ColorScale::Direct, |scale| &scale.coloring.scale);
            let up = axis_of(member.job, self.axis);
            paint(Arc::make_mut(member.cloud), attribute, scale, up)?;
        }
        Ok(lacking)
    }
}

/// Returns the unit vector along which heights are measured for a file; zero if no axis is determined. `shared` is the
/// axis for files whose own up axis isn't certain.
fn axis_of(job: &ColorJob, shared: Option<Up>) -> DVec3 {
    // If neither axis is known, no heights are needed.
    job.up.or(shared).map_or(DVec3::ZERO, Up::vector)
}

/// Attribute values that are collected from files one after another, which needn't be in memory together.
#[derive(Default)]
pub struct Tallies {
    all: Vec<(ColorJob, Entry)>,
    axis: Option<Up>,
}

struct Entry {
    tally: Tally,
    name: String,
    direct: Option<(ColorScale, &'static str)>,
    /// Files that contributed values, in the order in which they were added, each once.
    paths: Vec<PathBuf>,
    known: HashSet<PathBuf>,
}

impl Tallies {
    /// Adds the values of splats that are drawn together. Returns the members whose files lack the attribute.
    pub fn add(&mut self, members: &mut [Member<'_>]) -> Vec<MissingAttribute> {
        self.settle_axis(members);
        let mut lacking = Vec::new();
        for (i, member) in members.iter().enumerate() {
            let (job, data) = (member.job, member.cloud.data());
            let up = axis_of(job, self.axis);
            match Attribute::of(&data.extras, data.colors.is_some(), &job.attribute) {
                Ok(attribute) => {
                    self.add_values(job, attribute, &data.extras, &mut attribute.values(member.cloud, up));
                }
                Err(mut known) => {
                    let others: Vec<String> = job.others.iter().filter(|name| !known.contains(name)).cloned().collect();
                    known.extend(others);
                    lacking.push(MissingAttribute { member: i, known });
                }
            }
        }
        lacking
    }

    /// Adds the attribute's values of the points of one file.
    ///
    /// # Errors
    /// The names of the file's attributes, if it lacks the requested one.
    pub fn add_points(&mut self, job: &ColorJob, points: &PointCloud) -> Result<(), Vec<String>> {
        let attribute = Attribute::of(&points.extras, points.colors.is_some(), &job.attribute)?;
        let up = axis_of(job, self.axis);
        let value = |i: usize| match attribute {
            Attribute::Column(index) => points.extras.get(index).map_or(f64::NAN, |column| column.values.get(i)),
            _ => (points.origin + points.positions.get(i)).dot(up),
        };
        self.add_values(job, attribute, &points.extras, &mut (0..points.len()).map(value));
        Ok(())
    }

    fn add_values(
        &mut self,
        job: &ColorJob,
        attribute: Attribute,
        extras: &[ExtraColumn],
        values: &mut dyn Iterator<Item = f64>,
    ) {
        let direct = attribute.direct();
        let is_own =
            |(other, entry): &(ColorJob, Entry)| other.shares_scale(job) && entry.direct.is_some() == direct.is_some();
        let at = self.all.iter().position(is_own).unwrap_or_else(|| {
            let name = attribute.name(extras);
            // Heights are measurements, not categories, even if few of them are distinct.
            let mut colors = job.colors.clone();
            if attribute == Attribute::Height && colors.labels.is_none() {
                colors.map.get_or_insert(Colormap::Viridis.into());
            }
            let tally = Tally::new(&name, &colors);
            self.all.push((job.clone(), Entry { tally, name, direct, paths: Vec::new(), known: HashSet::new() }));
            self.all.len() - 1
        });
        let entry = &mut self.all[at].1;
        if entry.direct.is_none() {
            entry.tally.add(values);
        }
        if entry.known.insert(job.path.clone()) {
            entry.paths.push(job.path.clone());
        }
    }

    /// Determines the axis for the heights of all files whose own up axis isn't certain. The axis is that of a file
    /// with a certain one, or else an estimate from the common shape.
    fn settle_axis(&mut self, members: &mut [Member<'_>]) {
        let is_open = |member: &Member<'_>| {
            let data = member.cloud.data();
            let is_height = Attribute::of(&data.extras, false, &member.job.attribute) == Ok(Attribute::Height);
            member.job.up.is_none() && is_height
        };
        let Some(first) = members.iter().position(is_open).filter(|_| self.axis.is_none()) else { return };
        let object = |member: &Member<'_>| Object {
            geometry: Geometry::Splats(member.cloud.clone()),
            world_from_object: DAffine3::IDENTITY,
            material: Material::default(),
        };
        let stated = members.iter().find_map(|member| member.job.up);
        self.axis = stated.or_else(|| {
            let objects: Vec<Object> = members.iter().map(object).collect();
            Some(upright(&objects, members[first].job.convention).up)
        });
    }

    /// Returns the colour scales for all values that were added. Scales in `known`, from an earlier call, are
    /// preserved.
    fn scales(self, known: &[Scale]) -> Vec<Scale> {
        let of = |(job, entry): (ColorJob, Entry)| {
            let Entry { tally, name, direct, paths, .. } = entry;
            let (scale, note) = match direct {
                Some((scale, note)) => (scale, note.to_owned()),
                None => {
                    let is_same =
                        |other: &&Scale| other.job.shares_scale(&job) && other.coloring.scale != ColorScale::Direct;
                    let (known, missing) = (known.iter().find(is_same), tally.missing);
                    let scale = tally.scale(known.map(|known| &known.coloring.scale));
                    let note = words(&name, &scale, job.colors.range.is_some(), paths.len(), missing);
                    (scale, note)
                }
            };
            Scale { job, coloring: Coloring { attribute: name, scale }, note, paths }
        };
        self.all.into_iter().map(of).collect()
    }

    /// Returns the colouring for an attribute and a note about it, from the values that were added; `None` if no file
    /// has the attribute.
    pub fn coloring(self, attribute: &str) -> Option<(Coloring, String)> {
        let mut scales = self.scales(&[]);
        let named = |scale: &Scale| scale.job.attribute.eq_ignore_ascii_case(attribute);
        let numbers = scales.iter().position(|s| named(s) && s.coloring.scale != ColorScale::Direct);
        let at = numbers.or_else(|| scales.iter().position(named))?;
        let Scale { coloring, note, .. } = scales.swap_remove(at);
        Some((coloring, note))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::coloring::{GREY, linear, maps};
    use surfel_model::{ExtraValues, OnInvalid};

    /// Returns splats stacked along z.
    fn cloud(name: &str, values: ExtraValues) -> Arc<SplatCloud> {
        let n = values.len();
        let centers: Vec<[f32; 3]> = (0..n).map(|i| [0.0, 0.0, i as f32]).collect();
        let made = SplatCloud::disks(&centers, &vec![[0.0, 0.0, 1.0_f32]; n], &vec![1.0; n]).unwrap();
        let mut data = made.into_data();
        data.extras.push(ExtraColumn { name: name.into(), values });
        Arc::new(SplatCloud::new(data, OnInvalid::Refuse).unwrap().0)
    }

    fn job(path: &str, attribute: &str) -> ColorJob {
        let (path, attribute, convention) = (path.into(), attribute.to_owned(), UpConvention::Points);
        ColorJob { path, attribute, colors: Colors::default(), up: Some(Up::PlusZ), convention, others: Vec::new() }
    }

    /// Colours clouds together, each from its own file.
    fn color(clouds: &mut [Arc<SplatCloud>], job: &ColorJob) -> (Colorings, Vec<usize>) {
        let jobs: Vec<ColorJob> =
            (0..clouds.len()).map(|i| ColorJob { path: format!("{i}.ply").into(), ..job.clone() }).collect();
        let member = |(cloud, job)| Member { job, cloud, is_colored: false };
        let mut colorings = Colorings::default();
        let lacking = colorings.color(&mut clouds.iter_mut().zip(&jobs).map(member).collect::<Vec<_>>()).unwrap();
        (colorings, lacking.iter().map(|lacking| lacking.member).collect())
    }

    fn levels(cloud: &SplatCloud) -> Vec<[u8; 3]> {
        let encode = |c: f32| (0..=255_u8).find(|l| (linear(f64::from(*l) / 255.0) - c).abs() < 1e-7).unwrap();
        (0..cloud.len()).map(|i| cloud.color(i).map(encode)).collect()
    }

    fn only_scale(colorings: &Colorings) -> (ColorScale, String) {
        assert_eq!(colorings.scales.len(), 1);
        (colorings.scales[0].coloring.scale.clone(), colorings.scales[0].note.clone())
    }

    #[test]
    fn values_within_the_range_have_the_map_s_colours_and_none_is_grey() {
        let c = cloud("scalar_Temp", ExtraValues::F32(vec![-5.0, 0.0, 5.0, 10.0, 99.0, f32::NAN]));
        let colors = Colors { map: Some(Colormap::Viridis.into()), range: Some([0.0, 10.0]), labels: None };
        let mut clouds = [c];
        let (found, _) = color(&mut clouds, &ColorJob { colors, ..job("", "temp") });
        let (scale, note) = only_scale(&found);
        assert_eq!(scale, ColorScale::Range { map: Colormap::Viridis.into(), range: [0.0, 10.0] });
        assert!(note.contains("scalar_Temp by viridis from 0 to 10; 1 without a value"), "{note}");
        let (dark, middle, light) = ([68, 1, 84], [33, 145, 140], [253, 231, 37]);
        assert_eq!(levels(&clouds[0]), [dark, dark, middle, light, light, [GREY; 3]]);
    }

    #[test]
    fn files_that_are_drawn_together_share_a_range() {
        let values = |from: u32| ExtraValues::F64((from..from + 51).map(|i| f64::from(i) + 0.5).collect());
        let mut clouds = [cloud("intensity", values(0)), cloud("Intensity", values(50))];
        let (found, _) = color(&mut clouds, &job("", "Intensity"));
        let (scale, note) = only_scale(&found);
        // 0.5 to 50.5 and 50.5 to 100.5: two percent of 102 values are two at each end.
        assert_eq!(scale, ColorScale::Range { map: Colormap::Grey.into(), range: [2.5, 98.5] });
        assert!(note.contains("by grey from 2.5000 to 98.50, the 2nd to the 98th percentile of all 2 files"), "{note}");
        assert_eq!(levels(&clouds[0])[50], levels(&clouds[1])[0], "the same value has the same colour");
        assert_eq!(found.iter().map(|(path, _)| path.to_str().unwrap()).collect::<Vec<_>>(), ["0.ply", "1.ply"]);
    }

    #[test]
    fn legends_hold_the_classes_of_all_files() {
        let mut clouds = [
            cloud("Classification", ExtraValues::U8(vec![2, 6, 2, 200])),
            cloud("scalar_Classification", ExtraValues::F32(vec![9.0, 2.0])),
        ];
        let (found, _) = color(&mut clouds, &job("", "classification"));
        let (ColorScale::Categories(all), note) = only_scale(&found) else { panic!() };
        let counts: Vec<_> = all.iter().map(|c| (c.value, c.count)).collect();
        assert_eq!(counts, [(2.0, 3), (6.0, 1), (9.0, 1), (200.0, 1)]);
        assert!(note.contains("(2 ground 3, 6 building 1, 9 water 1, 200: 1)"), "{note}");
        let tab20 = maps::levels(Colormap::Tab20);
        assert_eq!(levels(&clouds[0])[3], tab20[0], "200 is 0 of twenty");
        // Integers are categories as long as all files together have at most twenty.
        let level = |from: i16, to: i16| cloud("level", ExtraValues::I16((from..to).collect()));
        let mut few = [level(-1, 9), level(5, 19)];
        let (found, _) = color(&mut few, &job("", "level"));
        assert!(matches!(only_scale(&found).0, ColorScale::Categories(all) if all.len() == 20));
        assert_eq!(levels(&few[0])[..2], [tab20[19], tab20[0]]);
        let (found, _) = color(&mut [level(0, 12), level(10, 22)], &job("", "level"));
        assert!(matches!(only_scale(&found).0, ColorScale::Range { map: ColorMap::Named(Colormap::Viridis), .. }));
    }

    #[test]
    fn heights_and_normals_need_no_attribute_and_files_without_one_are_told() {
        let mut clouds = [cloud("a", ExtraValues::U8(vec![0; 3]))];
        let colors = Colors { range: Some([-2.0, 0.0]), ..Colors::default() };
        let down = ColorJob { up: Some(Up::MinusZ), colors, ..job("", "height") };
        color(&mut clouds, &down);
        assert_eq!((levels(&clouds[0])[0], levels(&clouds[0])[2]), ([253, 231, 37], [68, 1, 84]), "down is up");
        let (found, _) = color(&mut clouds, &job("", "normal"));
        assert_eq!(only_scale(&found).0, ColorScale::Direct);
        assert_eq!(clouds[0].color(0), [linear(0.5), linear(0.5), 1.0]);
        let mut two = [cloud("a", ExtraValues::U8(vec![0; 3])), cloud("b", ExtraValues::U8(vec![1, 2, 3]))];
        let (found, lacking) = color(&mut two, &job("", "b"));
        assert_eq!((lacking, levels(&two[0]), found.iter().count()), (vec![0], vec![[GREY; 3]; 3], 1));
        let known = Attribute::of(&clouds[0].data().extras, true, "b").unwrap_err();
        assert_eq!(known, ["rgb", "height", "normal", "a"]);
    }

    #[test]
    fn scales_that_are_known_stay_for_what_is_drawn_later() {
        let coarse = cloud("a", ExtraValues::F32(vec![0.0, 0.5, 100.0]));
        let mut colorings = Colorings::default();
        let job = job("a.laz", "a");
        let mut first = coarse.clone();
        colorings.color(&mut [Member { job: &job, cloud: &mut first, is_colored: false }]).unwrap();
        let (before, _) = only_scale(&colorings);
        let mut finer = cloud("a", ExtraValues::F32(vec![3.5, 70.0, 500.0]));
        colorings.color(&mut [Member { job: &job, cloud: &mut finer, is_colored: false }]).unwrap();
        assert_eq!(only_scale(&colorings).0, before);
        assert_eq!(levels(&finer)[2], levels(&first)[2], "beyond the range");
    }

    #[test]
    fn files_that_do_not_say_their_axis_share_one() {
        // A slope in tiles, each of which alone would get another axis than all of them together.
        let mut two = [cloud("a", ExtraValues::U8(vec![0; 9])), cloud("a", ExtraValues::U8(vec![0; 9]))];
        let unknown = ColorJob { up: None, ..job("", "height") };
        let (found, _) = color(&mut two, &unknown);
        let shared = found.axis.unwrap();
        let jobs = [unknown.clone(), ColorJob { up: Some(Up::MinusY), ..unknown }];
        let mut with_known = Colorings::default();
        let [a, b] = &mut two;
        let member = |job, cloud| Member { job, cloud, is_colored: false };
        with_known.color(&mut [member(&jobs[0], a), member(&jobs[1], b)]).unwrap();
        assert_eq!((with_known.axis, shared.vector().length()), (Some(Up::MinusY), 1.0));
    }
}
