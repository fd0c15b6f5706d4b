//! Estimates of the memory for loading points, so that files that won't fit are refused before they are read.

use crate::Error;
use std::path::Path;
use surfel_io::{PointCount, byte_size};
use surfel_model::PointCloud;

/// Peak memory, in bytes per point, for points without normals and radii, from reading to drawing. It includes reading,
/// searching for neighbours, making a splat, and uploading it to the CPU backend. The size of the point's row in the
/// file is added. Peaks measured for 3 to 4 million points are within 20 % of these constants plus the row. The
/// measured formats are PLY, PCD, NPY, NPZ, LAS, LAZ, E57 and text.
const PREPARED_BYTES: u64 = 49;
/// Peak memory, in bytes per point, for points with normals but without radii, like [`PREPARED_BYTES`].
const NORMAL_BYTES: u64 = 44;
/// Peak memory, in bytes per point, for points with radii, like [`PREPARED_BYTES`].
const RADIUS_BYTES: u64 = 25;
/// Additional peak memory, in bytes per point, for points with colours, of the point and the splat together.
const COLOR_BYTES: u64 = 24;
/// Peak memory, in bytes per point, for a COPC file that states normals and radii. Measured: 87 bytes with 4 million
/// points.
pub const KNOWN_BYTES: u64 = 90;
/// Peak memory, in bytes per point, for a COPC file that also states colours, of the points and of level averages.
/// Measured: 105 bytes.
pub(crate) const KNOWN_COLORED_BYTES: u64 = 110;
/// Peak memory, in bytes per point, that the C library's heap retains from freed arrays. It is added for clouds of
/// fewer than [`RETAINED_POINTS`] points. With 0.5 to 2 million points, measured peaks are 16 to 46 bytes above the sum
/// of the other constants.
const RETAINED_BYTES: u64 = 28;
/// Number of points from which the heap retains no freed arrays. Most arrays (12 to 16 bytes per point) then have at
/// least 32 MiB, and glibc returns them to the system immediately.
const RETAINED_POINTS: u64 = (32 << 20) / 16;
/// Fraction of the available memory that the default budget uses.
const SHARE: f64 = 0.6;

/// Returns the default memory budget in bytes, which is 60 % of the smallest of these limits:
///
/// - the machine's memory;
/// - the limit of the process's control groups (of a container or batch job);
/// - the unused address space below its limit (`ulimit -v`).
///
/// Returns `None` if none of them can be determined.
pub fn default_budget() -> Option<u64> {
    let machine = std::fs::read_to_string("/proc/meminfo").ok().and_then(|text| {
        let kib = text.lines().find_map(|line| line.strip_prefix("MemTotal:"))?;
        kib.split_whitespace().next()?.parse::<u64>().ok().map(|kib| kib << 10)
    });
    let groups = std::fs::read_to_string("/proc/self/cgroup").unwrap_or_default();
    let group = group_limit(Path::new("/sys/fs/cgroup"), &groups);
    let own = |file: &str| std::fs::read_to_string(Path::new("/proc/self").join(file)).unwrap_or_default();
    let space = address_space_left(&own("limits"), || own("status"));
    let bytes = machine.into_iter().chain(group).chain(space).min()?;
    Some((bytes as f64 * SHARE) as u64)
}

/// Returns the number of bytes between the address space in use (in `/proc/self/status`) and its soft limit (in
/// `/proc/self/limits`); `None` without a limit.
fn address_space_left(limits: &str, status: impl FnOnce() -> String) -> Option<u64> {
    let limit = limits.lines().find_map(|line| line.strip_prefix("Max address space"))?;
    let limit: u64 = limit.split_whitespace().next()?.parse().ok()?;
    let status = status();
    let used = status.lines().find_map(|line| line.strip_prefix("VmSize:"))?;
    let used: u64 = used.split_whitespace().next()?.parse().ok()?;
    Some(limit.saturating_sub(used << 10))
}

/// Returns the smallest memory limit, in bytes, of the process's control groups and their ancestors, for either version
/// (cgroups(7)); `None` without a limit. `mounted` is the folder of the control groups, and `groups` has the format of
/// `/proc/self/cgroup`.
fn group_limit(mounted: &Path, groups: &str) -> Option<u64> {
    let limits = groups.lines().flat_map(|line| {
        let mut fields = line.splitn(3, ':').skip(1);
        let (controllers, path) = (fields.next().unwrap_or(""), fields.next().unwrap_or("/"));
        let (folder, name) = match controllers.split(',').find(|c| c.is_empty() || *c == "memory") {
            Some("") => (mounted.to_path_buf(), "memory.max"),
            Some(_) => (mounted.join("memory"), "memory.limit_in_bytes"),
            None => return Vec::new(),
        };
        // In a container, the path may be the host's path, and only the outermost folder exists.
        let around = Path::new(path.trim_start_matches('/')).ancestors();
        around.map(|group| folder.join(group).join(name)).collect()
    });
    limits.filter_map(|file| std::fs::read_to_string(file).ok()?.trim().parse().ok()).min()
}

/// Returns the peak memory in bytes per point of a file that hasn't been read, from reading to drawing.
pub(crate) fn loaded_bytes(count: &PointCount) -> u64 {
    let known = match count {
        PointCount { has_radii: true, .. } => RADIUS_BYTES,
        PointCount { has_normals: true, .. } => NORMAL_BYTES + retained_bytes(count.points),
        _ => PREPARED_BYTES + retained_bytes(count.points),
    };
    known + count.row_bytes + if count.has_colors { COLOR_BYTES } else { 0 }
}

/// Returns the peak memory, in bytes per point, that the heap retains after neighbours were searched: 0 from
/// [`RETAINED_POINTS`] points on, and without the GNU C library.
fn retained_bytes(points: u64) -> u64 {
    if points < RETAINED_POINTS && cfg!(target_env = "gnu") { RETAINED_BYTES } else { 0 }
}

/// Returns the peak memory in bytes per point for points that have been read, up to drawing. Memory that the heap
/// retains isn't included, because the points may be a selection of a COPC file that was chosen to fit.
pub(crate) fn prepared_bytes(points: &PointCloud) -> u64 {
    let extra_bytes: u64 = points.extras.iter().map(|extra| extra.values.value_bytes() as u64).sum();
    let known = if points.normals.is_some() { NORMAL_BYTES } else { PREPARED_BYTES };
    known + extra_bytes + if points.colors.is_some() { COLOR_BYTES } else { 0 }
}

/// Suggestion in the error message for points that won't fit into memory.
#[derive(Clone, Copy)]
pub(crate) enum Remedy {
    /// Convert the file to COPC, and draw the COPC file.
    Levels,
    /// Draw fewer points, by `max_points`.
    Fewer,
    /// Draw fewer points, or convert the points to LAZ.
    Points,
}

/// Returns an error if `points` points of `point_bytes` bytes each need more memory than `budget`. If `budget` is
/// `None`, the limit is [`default_budget`].
pub(crate) fn check(
    path: &Path,
    points: u64,
    point_bytes: u64,
    budget: Option<u64>,
    remedy: Remedy,
) -> Result<(), Error> {
    let needed = points.saturating_mul(point_bytes);
    let Some(budget) = budget.or_else(default_budget).filter(|budget| needed > *budget) else { return Ok(()) };
    let fewer = format!("draw at most {} points (`max_points`)", budget / point_bytes);
    let remedy = match remedy {
        Remedy::Levels => {
            "write it by levels (surfel convert FILE -o FILE.copc.laz, with 200M at least) and draw that".to_owned()
        }
        Remedy::Fewer => fewer,
        Remedy::Points => format!("{fewer}, or write them as LAZ, which can be drawn by levels"),
    };
    let problem = format!(
        "has {points} points to draw, which take some {} of memory at {point_bytes} bytes each, and {} may be used: \
         {remedy}, or allow more (`memory`)",
        byte_size(needed),
        byte_size(budget),
    );
    Err(Error::Unsuitable { path: path.to_path_buf(), problem })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_that_do_not_fit_are_refused_with_what_to_do() {
        let checked = |points, budget| check(Path::new("a.laz"), points, 300, Some(budget), Remedy::Levels);
        assert!(checked(1_000_000, 300_000_000).is_ok());
        let error = checked(1_000_001, 300_000_000).unwrap_err().to_string();
        assert!(error.contains("300 MB") && error.contains("surfel convert") && error.contains("`memory`"), "{error}");
        assert!(checked(u64::MAX, u64::MAX).is_ok());
    }

    #[test]
    fn bytes_of_points_are_near_what_was_measured() {
        // Peak minus that of 500 points, per point, at 512² on the CPU backend or of a conversion, whichever is larger.
        const LARGE: u64 = 4_000_000;
        for (what, points, measured, row_bytes, has_normals, has_colors) in [
            ("PLY x y z", LARGE, 67, 12, false, false),
            ("PLY with colours", LARGE, 91, 15, false, true),
            ("PLY with normals", LARGE, 75, 24, true, false),
            ("PLY with normals and colours", LARGE, 94, 27, true, true),
            ("PLY of f64", LARGE, 81, 24, false, false),
            ("PLY with colours and 8 floats", LARGE, 128, 47, false, true),
            ("PLY of f64 with colours", LARGE, 99, 27, false, true),
            ("NPY", LARGE, 67, 12, false, false),
            ("NPY of f64", LARGE, 67, 24, false, false),
            ("NPZ with colours", LARGE, 94, 15, false, true),
            ("PCD with colours", LARGE, 90, 20, false, true),
            ("E57 with colours", LARGE, 91, 19, false, true),
            // 24 bytes for reading and positions, and the columns that hold values. The heap's threshold for large
            // arrays was fixed for all columns.
            ("LAS of format 7, all columns", LARGE, 135, 24 + 26, false, true),
            ("LAS of format 7, few columns", LARGE, 102, 24, false, true),
            ("LAS of format 7, positions alone", LARGE, 71, 24, false, false),
            ("LAS of format 6, all columns", LARGE, 98, 24 + 26, false, false),
            ("LAS of format 1, all columns", LARGE, 97, 24 + 21, false, false),
            ("LAZ of format 7, all columns", LARGE, 131, 24 + 26, false, true),
            ("LAZ of format 6, all columns", LARGE, 121, 24 + 26, false, false),
            ("LAZ of format 0, positions alone", LARGE, 73, 24, false, false),
            ("LAZ of format 0 with intensity", LARGE, 81, 24 + 2, false, false),
            ("LAS of format 0, positions alone", LARGE, 76, 24, false, false),
            ("LAZ of format 0, positions alone", 3_000_000, 76, 24, false, false),
            ("LAZ of format 0, positions alone", 2_150_000, 84, 24, false, false),
            ("LAZ of format 0, positions alone", 2_600_000, 76, 24, false, false),
            ("LAZ of format 7, few columns", LARGE, 98, 24, false, true),
            ("LAZ of format 7, few columns", 3_000_000, 100, 24, false, true),
            ("text x y z", LARGE, 67, 21, false, false),
            ("text x y z, long numbers", LARGE, 84, 48, false, false),
            ("text with intensity", LARGE, 73, 24, false, false),
            ("text with colours", LARGE, 111, 39, false, true),
            ("text with colours, short numbers", LARGE, 104, 32, false, true),
            ("CSV with colours", LARGE, 103, 32, false, true),
            ("PTS", LARGE, 119, 35, false, true),
            // Smaller files, of whose arrays the heap retains some.
            ("PLY x y z", 2_000_000, 92, 12, false, false),
            ("PLY with colours", 2_000_000, 104, 15, false, true),
            ("PLY with normals", 2_000_000, 84, 24, true, false),
            ("NPY", 2_000_000, 89, 12, false, false),
            ("NPY of f64", 2_000_000, 89, 24, false, false),
            ("LAS of format 0, positions alone", 2_000_000, 109, 24, false, false),
            ("LAS of format 1, five columns", 2_000_000, 129, 24 + 13, false, false),
            ("LAS of format 6 with intensity", 2_000_000, 121, 24 + 2, false, false),
            ("LAS of format 7, few columns", 2_000_000, 138, 24, false, true),
            ("LAS of format 7, three columns", 2_000_000, 149, 24 + 11, false, true),
            ("LAZ of format 0, positions alone", 2_000_000, 118, 24, false, false),
            ("LAZ of format 0, positions alone", 1_000_000, 112, 24, false, false),
            ("LAZ of format 0, positions alone", 500_000, 100, 24, false, false),
            ("LAZ of format 0 with intensity", 2_000_000, 111, 24 + 2, false, false),
            ("LAZ of format 1, five columns", 2_000_000, 118, 24 + 13, false, false),
            ("LAZ of format 6 with intensity", 2_000_000, 119, 24 + 2, false, false),
            ("LAZ of format 7, few columns", 2_000_000, 135, 24, false, true),
            ("LAZ of format 7, few columns", 1_000_000, 136, 24, false, true),
            ("LAZ of format 7, three columns", 2_000_000, 139, 24 + 11, false, true),
            ("text x y z", 2_000_000, 113, 21, false, false),
            ("text with colours, short numbers", 2_000_000, 137, 32, false, true),
        ] {
            let count = PointCount { points, has_radii: false, has_normals, has_colors, row_bytes };
            let estimate = loaded_bytes(&count) as f64;
            let is_near = (estimate / f64::from(measured) - 1.0).abs() < 0.2;
            assert!(is_near || !cfg!(target_env = "gnu"), "{points} points of {what}: {estimate}");
        }
    }

    #[test]
    fn groups_and_those_around_them_limit_memory() {
        let folder = std::env::temp_dir().join(format!("surfel-groups-{}", std::process::id()));
        let write = |file: &str, text: &str| {
            let file = folder.join(file);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(file, text).unwrap();
        };
        let limit = |groups: &str| group_limit(&folder, groups);
        assert_eq!(limit("0::/job/step\n"), None);
        write("job/step/memory.max", "max\n");
        write("job/memory.max", "3000\n");
        assert_eq!(limit("0::/job/step\n"), Some(3000));
        write("memory.max", "2000\n");
        assert_eq!(limit("0::/of/the/host\n"), Some(2000));
        write("memory/job/memory.limit_in_bytes", "1000\n");
        write("memory/memory.limit_in_bytes", "9223372036854771712\n");
        assert_eq!(limit("9:cpu,cpuacct:/job\n4:memory:/job\n"), Some(1000));
        assert_eq!(limit("4:memory:/other\n"), Some(9_223_372_036_854_771_712));
        assert_eq!((limit(""), limit("::")), (None, Some(2000)));
        std::fs::remove_dir_all(&folder).unwrap();
    }

    #[test]
    fn limits_of_address_space_leave_what_is_not_in_use() {
        let limits = |soft: &str| {
            format!(
                "Limit                     Soft Limit           Hard Limit           Units     \n\
                 Max resident set          1000                 unlimited            bytes     \n\
                 Max address space         {soft:<20} unlimited            bytes     \n"
            )
        };
        let left = |soft: &str, status: &str| address_space_left(&limits(soft), || status.to_owned());
        let status = "Name:\tsurfel\nVmPeak:\t   9000 kB\nVmSize:\t   1000 kB\nVmRSS:\t     500 kB\n";
        assert_eq!(left("unlimited", status), None);
        assert_eq!(left("3024000", status), Some(2_000_000));
        assert_eq!(left("1000", status), Some(0));
        assert_eq!((left("3024000", ""), address_space_left("", || status.to_owned())), (None, None));
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn machine_has_memory() {
        assert!(default_budget().is_some_and(|bytes| bytes > 1 << 26));
    }
}
