//! Round trips of known poses through each program's format: points must project where the formula puts them.

use super::*;
use glam::{DQuat, DVec2};
use surfel_model::Projection;

/// A folder that is removed afterwards.
struct Folder(PathBuf);

impl Folder {
    fn new(name: &str) -> Self {
        let path = std::env::temp_dir().join(format!("surfel-cameras-{}-{name}", std::process::id()));
        let _ = std::fs::remove_dir_all(&path);
        std::fs::create_dir_all(&path).unwrap();
        Self(path)
    }

    fn write(&self, name: &str, content: impl AsRef<[u8]>) -> PathBuf {
        let path = self.0.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, content).unwrap();
        path
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// A reference camera, which projects a world point X to the pixel x = K(RX + t). K consists of `focal` and
/// `principal`, in the pixel convention of the tested program.
struct Truth {
    r: DMat3,
    t: DVec3,
    focal: [f64; 2],
    principal: [f64; 2],
}

const SIZE: [u32; 2] = [640, 480];
/// Tolerance of projected points, in pixels. The files' numbers have a limited number of digits.
const TOLERANCE_PX: f64 = 1e-6;

/// Returns a camera far from the origin, rotated about all axes.
fn truth() -> Truth {
    let q = DQuat::from_xyzw(0.3, -0.5, 0.2, 0.7).normalize();
    let r = DMat3::from_quat(q);
    let eye = DVec3::new(4.0e3, -2.5e3, 120.0);
    Truth { r, t: -(r * eye), focal: [600.0, 610.0], principal: [310.0, 250.0] }
}

impl Truth {
    fn q(&self) -> DQuat {
        DQuat::from_mat3(&self.r)
    }

    fn eye(&self) -> DVec3 {
        -(self.r.transpose() * self.t)
    }

    fn pixel(&self, world: DVec3) -> DVec2 {
        let p = self.r * world + self.t;
        DVec2::from(self.focal) * p.truncate() / p.z + DVec2::from(self.principal)
    }

    /// Returns points in front of the camera.
    fn points(&self) -> Vec<DVec3> {
        let view = [[0.0, 0.0, 1.0], [1.0, -0.5, 3.0], [-20.0, 30.0, 90.0], [0.4, 0.3, 0.5]];
        view.iter().map(|p| self.r.transpose() * (DVec3::from(*p) - self.t)).collect()
    }

    /// Compares a camera with this one, whose pixel coordinates start `corner` pixels right of and below the image's
    /// upper left corner.
    #[track_caller]
    fn agrees(&self, camera: &Camera, corner: f64) {
        let (eye, target) = (DVec3::from(camera.eye), DVec3::from(camera.target));
        let forward = (target - eye).normalize();
        let right = forward.cross(DVec3::from(camera.up)).normalize();
        let down = forward.cross(right);
        let Projection::Intrinsics { fx, fy, cx, cy } = camera.projection else { panic!("{camera:?}") };
        for point in self.points() {
            let d = point - eye;
            let p = DVec2::new(fx * d.dot(right), fy * d.dot(down)) / d.dot(forward) + DVec2::new(cx, cy);
            let error = (p - self.pixel(point) - corner).length();
            assert!(error < TOLERANCE_PX, "{error} px: {p}, {}", self.pixel(point));
        }
        camera.validate().unwrap();
    }
}

fn rows(m: DMat3) -> Vec<[f64; 3]> {
    (0..3).map(|i| m.row(i).into()).collect()
}

#[track_caller]
fn one(path: &Path) -> NamedCamera {
    let cameras = read(path).unwrap();
    assert_eq!(cameras.len(), 1);
    cameras.into_iter().next().unwrap()
}

fn colmap_text(truth: &Truth, model: &str) -> (String, String) {
    let Truth { t, focal: [fx, fy], principal: [cx, cy], .. } = truth;
    let q = truth.q();
    let cameras = match model {
        "SIMPLE_PINHOLE" => format!("7 SIMPLE_PINHOLE 640 480 {fx} {cx} {cy}"),
        "PINHOLE" => format!("7 PINHOLE 640 480 {fx} {fy} {cx} {cy}"),
        other => format!("7 {other} 640 480 {fx} {fy} {cx} {cy} 0.1 0 0 0"),
    };
    let image = format!("1 {} {} {} {} {} {} {} 7 left/a b.JPG", q.w, q.x, q.y, q.z, t.x, t.y, t.z);
    (format!("# list\n{cameras}\n"), format!("# list\n# of two lines each\n{image}\n\n"))
}

fn colmap_binary(truth: &Truth) -> (Vec<u8>, Vec<u8>) {
    let Truth { t, focal: [fx, fy], principal: [cx, cy], .. } = truth;
    let q = truth.q();
    let mut cameras = 1u64.to_le_bytes().to_vec();
    cameras.extend(7u32.to_le_bytes().into_iter().chain(1u32.to_le_bytes()));
    cameras.extend([640u64, 480].into_iter().flat_map(u64::to_le_bytes));
    cameras.extend([*fx, *fy, *cx, *cy].into_iter().flat_map(f64::to_le_bytes));
    let mut images = 2u64.to_le_bytes().to_vec();
    for name in ["left/a b.JPG", "right/a b.JPG"] {
        images.extend(1u32.to_le_bytes());
        images.extend([q.w, q.x, q.y, q.z, t.x, t.y, t.z].into_iter().flat_map(f64::to_le_bytes));
        images.extend(7u32.to_le_bytes());
        images.extend(name.bytes().chain([0]));
        images.extend(1u64.to_le_bytes());
        images.extend([0; 24]);
    }
    (cameras, images)
}

#[test]
fn colmap_cameras_reproject_known_points() {
    let truth = truth();
    let folder = Folder::new("colmap");
    let (cameras, images) = colmap_text(&truth, "PINHOLE");
    folder.write("text/cameras.txt", cameras);
    let file = folder.write("text/images.txt", images);
    for path in [&folder.0.join("text"), &file] {
        let camera = one(path);
        assert_eq!((camera.name.as_str(), camera.size), ("a b", Some(SIZE)));
        truth.agrees(&camera.camera(None).unwrap(), 0.0);
    }
    let square = Truth { focal: [600.0; 2], ..truth };
    let (cameras, images) = colmap_text(&square, "SIMPLE_PINHOLE");
    folder.write("text/cameras.txt", cameras);
    folder.write("text/images.txt", images);
    square.agrees(&one(&file).camera(None).unwrap(), 0.0);

    let (cameras, images) = colmap_binary(&square);
    folder.write("sparse/0/cameras.bin", cameras);
    folder.write("sparse/0/images.bin", images);
    let both = read(&folder.0.join("sparse/..")).unwrap();
    let names: Vec<&str> = both.iter().map(|camera| camera.name.as_str()).collect();
    assert_eq!(names, ["left_a b", "right_a b"]);
    square.agrees(&both[1].camera(None).unwrap(), 0.0);
}

#[test]
fn smaller_images_show_the_same() {
    let truth = truth();
    let folder = Folder::new("smaller");
    let (cameras, images) = colmap_binary(&truth);
    folder.write("cameras.bin", cameras);
    folder.write("images.bin", images);
    let half = Truth { focal: [300.0, 305.0], principal: [155.0, 125.0], ..truth };
    half.agrees(&read(&folder.0).unwrap()[0].camera(Some([320, 240])).unwrap(), 0.0);
}

#[test]
fn transforms_reproject_known_points() {
    let truth = truth();
    let folder = Folder::new("transforms");
    let axes = truth.r.transpose();
    let eye = truth.eye();
    let row = |i: usize| [axes.x_axis[i], -axes.y_axis[i], -axes.z_axis[i], eye[i]];
    let matrix = serde_json::json!([row(0), row(1), row(2), [0, 0, 0, 1]]);
    let frame = serde_json::json!({ "file_path": "./images/f_0.5.png", "transform_matrix": matrix });
    let file = serde_json::json!({ "fl_x": 600.0, "fl_y": 610.0, "cx": 310, "cy": 250.0, "w": 640, "h": 480,
        "k1": 0.0, "camera_model": "OPENCV", "aabb_scale": 16, "frames": [frame] });
    folder.write("transforms.json", file.to_string());
    let camera = one(&folder.0);
    assert_eq!(camera.name, "f_0.5");
    truth.agrees(&camera.camera(None).unwrap(), 0.0);

    // Only a field of view, as in NeRF's synthetic scenes, which don't state the image size.
    let angle = 2.0 * (0.5 * 640.0 / 600.0f64).atan();
    let file = serde_json::json!({ "camera_angle_x": angle, "frames": [
        { "file_path": "./train/r_0", "transform_matrix": matrix }, { "file_path": "./train/r_1",
          "transform_matrix": matrix, "fl_x": 610.0, "fl_y": 610.0, "cx": 1.0, "cy": 2.0 } ] });
    let path = folder.write("transforms_train.json", file.to_string());
    let cameras = read(&path).unwrap();
    assert!(cameras[0].camera(None).unwrap_err().to_string().contains("`size=WxH`"));
    let centred = Truth { focal: [600.0; 2], principal: [320.0, 240.0], ..truth };
    centred.agrees(&cameras[0].camera(Some(SIZE)).unwrap(), 0.0);
    let own = Truth { focal: [610.0; 2], principal: [1.0, 2.0], ..centred };
    own.agrees(&cameras[1].camera(Some(SIZE)).unwrap(), 0.0);
}

#[test]
fn matrices_of_opencv_open3d_and_3dgs_reproject_known_points() {
    let truth = truth();
    let folder = Folder::new("matrices");
    let Truth { r, t, focal: [fx, fy], principal: [cx, cy] } = truth;
    let t = t.to_array();
    let k = serde_json::json!([[fx, 0, cx], [0, fy, cy], [0, 0, 1]]);
    let (axis, angle) = truth.q().to_axis_angle();
    for (key, rotation) in [
        ("R", serde_json::json!(rows(r))),
        ("rotation", serde_json::json!(rows(r).concat())),
        ("rvec", serde_json::json!((axis * angle).to_array())),
    ] {
        let camera = serde_json::json!({ "K": k, key: rotation, "t": t, "size": SIZE, "dist": [0, 0.0, 0, 0, 0] });
        // OpenCV's pixel coordinates start at the first pixel's centre.
        truth.agrees(&one(&folder.write("a.json", camera.to_string())).camera(None).unwrap(), 0.5);
        let list = serde_json::json!({ "cameras": [camera, camera] });
        assert_eq!(read(&folder.write("a.json", list.to_string())).unwrap()[1].name, "0001");
    }

    let extrinsic: Vec<f64> =
        (0..4).flat_map(|i| if i < 3 { r.col(i).extend(0.0).to_array() } else { [t[0], t[1], t[2], 1.0] }).collect();
    let open3d = serde_json::json!({ "class_name": "PinholeCameraParameters", "extrinsic": extrinsic,
        "intrinsic": { "width": 640, "height": 480, "intrinsic_matrix": [fx, 0, 0, 0, fy, 0, cx, cy, 1] } });
    truth.agrees(&one(&folder.write("o.json", open3d.to_string())).camera(None).unwrap(), 0.5);
    let trajectory = serde_json::json!({ "class_name": "PinholeCameraTrajectory", "parameters": [open3d] });
    truth.agrees(&one(&folder.write("o.json", trajectory.to_string())).camera(None).unwrap(), 0.5);

    let centred = Truth { principal: [320.0, 240.0], ..truth };
    let gaussians = serde_json::json!([{ "id": 0, "img_name": "DSC0001", "width": 640, "height": 480,
        "position": centred.eye().to_array(), "rotation": rows(r.transpose()), "fx": fx, "fy": fy }]);
    folder.write("cameras.json", gaussians.to_string());
    let camera = one(&folder.0);
    assert_eq!(camera.name, "DSC0001");
    centred.agrees(&camera.camera(None).unwrap(), 0.0);
}

#[test]
fn kitti_cameras_reproject_points_of_the_scanner() {
    let folder = Folder::new("kitti");
    // The scanner's x is forward and its z up. The cameras are rectified by a small rotation, and one is displaced.
    let turn = DMat3::from_cols(DVec3::new(0.0, 0.0, 1.0), DVec3::new(-1.0, 0.0, 0.0), DVec3::new(0.0, -1.0, 0.0));
    let shift = DVec3::new(0.01, -0.07, -0.27);
    let rectify = DMat3::from_quat(DQuat::from_xyzw(0.01, 0.005, -0.003, 1.0).normalize());
    let aside = DVec3::new(-0.53, 0.001, 0.002);
    let k = DMat3::from_cols(DVec3::new(721.0, 0.0, 0.0), DVec3::new(0.0, 720.0, 0.0), DVec3::new(609.5, 172.8, 1.0));
    let truth =
        Truth { r: rectify * turn, t: rectify * shift + aside, focal: [721.0, 720.0], principal: [609.5, 172.8] };
    let list = |numbers: &[f64]| numbers.iter().map(f64::to_string).collect::<Vec<_>>().join(" ");
    let three_by_four =
        |m: DMat3, v: DVec3| list(&(0..3).flat_map(|i| m.row(i).extend(v[i]).to_array()).collect::<Vec<_>>());
    let p1 = three_by_four(k, k * aside);
    let p0 = three_by_four(k, DVec3::ZERO);
    let r = list(&rows(rectify).concat());
    let object = format!("P0: {p0}\nP1: {p1}\nR0_rect: {r}\nTr_velo_to_cam: {}\n\n", three_by_four(turn, shift));
    let cameras = read(&folder.write("000000.txt", object)).unwrap();
    assert_eq!((cameras.len(), cameras[1].name.as_str(), cameras[1].size), (2, "image_1", None));
    truth.agrees(&cameras[1].camera(Some([1242, 375])).unwrap(), 0.5);

    let raw = format!(
        "calib_time: 09-Jan-2012 13:57:47\nR_rect_00: {r}\nP_rect_00: {p0}\nS_rect_01: 1242 375\nP_rect_01: {p1}\n"
    );
    folder.write("calib_cam_to_cam.txt", raw);
    let scanner = format!("calib_time: x\nR: {}\nT: {}\n", list(&rows(turn).concat()), list(&shift.to_array()));
    folder.write("calib_velo_to_cam.txt", scanner);
    let cameras = read(&folder.0).unwrap();
    assert_eq!((cameras[1].name.as_str(), cameras[1].size), ("image_01", Some([1242, 375])));
    truth.agrees(&cameras[1].camera(None).unwrap(), 0.5);
}

#[test]
fn cameras_that_bend_rays_are_refused_with_what_to_run() {
    let truth = truth();
    let folder = Folder::new("distorted");
    let (cameras, images) = colmap_text(&truth, "OPENCV");
    let none = cameras.replace("0.1 0 0 0", "0 0 0 0");
    let file = folder.write("cameras.txt", cameras);
    folder.write("images.txt", images);
    let error = read(&file).unwrap_err().to_string();
    assert!(error.contains("OPENCV with distortion [0.1") && error.contains("image_undistorter"), "{error}");
    folder.write("cameras.txt", none);
    truth.agrees(&one(&file).camera(None).unwrap(), 0.0);
    folder.write("cameras.txt", "7 OPENCV_FISHEYE 640 480 1 1 1 1 0 0 0 0\n");
    assert!(read(&file).unwrap_err().to_string().contains("image_undistorter"));
    let identity = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
    let frames = [serde_json::json!({ "transform_matrix": identity })];
    let bent = serde_json::json!({ "fl_x": 1, "cx": 1, "cy": 1, "k1": 0.2, "frames": frames });
    let json = folder.write("t.json", bent.to_string());
    assert!(read(&json).unwrap_err().to_string().contains("k1 = 0.2"));
}

#[test]
fn cameras_that_no_image_uses_refuse_no_model() {
    let truth = truth();
    let folder = Folder::new("unused");
    let (cameras, images) = colmap_text(&truth, "PINHOLE");
    for unused in [
        "2 SIMPLE_RADIAL 640 480 600 320 240 0.05",
        "2 OPENCV_FISHEYE 640 480 600 600 320 240 0.1 0 0 0",
        "2 OPENCV 640 480 600 600 320 240",
        "2 MODEL_OF_TOMORROW 640 480 1 2 3",
        "2 PINHOLE 0 480 600 600 320 240",
        "2 PINHOLE 640 480 -1 nan 320 240",
        "2 PINHOLE 640 480 a b c d",
    ] {
        let file = folder.write("cameras.txt", format!("{unused}\n{cameras}{}\n", unused.replace("2 ", "9 ")));
        folder.write("images.txt", &images);
        truth.agrees(&one(&file).camera(None).unwrap(), 0.0);
        // A camera that an image uses does matter.
        folder.write("images.txt", images.replace(" 7 left", " 2 left"));
        let error = read(&file).unwrap_err().to_string();
        assert!(error.contains("image left/a b.JPG: ") && error.lines().count() <= 4, "{error}");
    }
    let (cameras, images) = colmap_binary(&truth);
    let radial =
        [&2_u32.to_le_bytes()[..], &3_u32.to_le_bytes(), &640_u64.to_le_bytes(), &480_u64.to_le_bytes()].concat();
    let parameters: Vec<u8> = [600.0, 320.0, 240.0, 0.1, 0.2_f64].iter().flat_map(|p| p.to_le_bytes()).collect();
    let file = folder.write("cameras.bin", [&2_u64.to_le_bytes()[..], &radial, &parameters, &cameras[8..]].concat());
    folder.write("images.bin", images);
    assert_eq!(read(&file).unwrap().len(), 2);
}

#[test]
fn bad_cameras_are_one_clear_error() {
    let folder = Folder::new("bad");
    let truth = truth();
    let (cameras, images) = colmap_binary(&truth);
    folder.write("cameras.bin", &cameras);
    for cut in 0..images.len() {
        folder.write("images.bin", &images[..cut]);
        let error = read(&folder.0).unwrap_err().to_string();
        assert!(error.contains("images.bin: ") && error.lines().count() <= 4, "{cut}: {error}");
    }
    let mut many = images.clone();
    many[..8].copy_from_slice(&u64::MAX.to_le_bytes());
    folder.write("images.bin", many);
    assert!(read(&folder.0).unwrap_err().to_string().contains("ends in the middle"));
    let pose = |m: &str| format!(r#"{{"K": [[1,0,1],[0,1,1],[0,0,1]], "R": {m}, "t": [0,0,0], "size": [4, 4]}}"#);
    for (text, part) in [
        ("{", "EOF"),
        ("[]", "holds no camera"),
        ("{}", "no cameras that are known"),
        ("3", "no cameras that are known"),
        (&pose("[[1,0,0],[0,1,0],[0,0,2]]"), "stretches"),
        (&pose("[[1,0,0],[0,1,0],[0,0,-1]]"), "mirrors"),
        (&pose("[[0,0,0],[0,0,0],[0,0,0]]"), "stretches"),
        (&pose("[1,2]"), "expected: 9 numbers"),
        (&pose("[[1,0,0],[0,1,0],[0,0,1]]").replace("[[1,0,1]", "[[1,0.5,1]"), "matrix K"),
        (&pose("[[1,0,0],[0,1,0],[0,0,1]]").replace("[[1,0,1]", "[[-1,0,1]"), "focal lengths"),
        (&pose("[[1,0,0],[0,1,0],[0,0,1]]").replace("[4, 4]", "[0, 4]"), "0x4"),
    ] {
        let error = read(&folder.write("x.json", text)).unwrap_err().to_string();
        assert!(error.contains(part) && error.lines().count() <= 4, "{text}: {error}");
    }
    for (text, part) in [("hello\n", "no name"), ("P0: 1 2 3\n", "3 numbers"), ("a: b\n", "no camera that is known")] {
        assert!(read(&folder.write("calib.txt", text)).unwrap_err().to_string().contains(part), "{text}");
    }
    let empty = Folder::new("empty");
    assert!(read(&empty.0).unwrap_err().to_string().contains("folder without cameras"));
    assert!(read(&empty.0.join("no")).is_err());
}
