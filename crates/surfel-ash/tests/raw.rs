//! Tests a renderer on a Vulkan device that the program, here the test, has created itself.

use ash::vk;
use surfel_ash::{RawDevice, Renderer};
use surfel_model::{Camera, CloudData, Column3, OnInvalid, Projection, Scene, Settings, Shape, SplatCloud};
use surfel_render::{Frame, Planes, Renderer as _, View};

/// Creates a device as a program might: without features, with one queue. Returns `None` if there is no device.
fn device() -> Option<RawDevice> {
    // SAFETY: the system's loader is trusted.
    let entry = unsafe { ash::Entry::load() }.ok()?;
    let application = vk::ApplicationInfo::default().api_version(vk::API_VERSION_1_1);
    let info = vk::InstanceCreateInfo::default().application_info(&application);
    // SAFETY: `info` lives through the call.
    let instance = unsafe { entry.create_instance(&info, None) }.ok()?;
    // SAFETY: the instance is alive.
    let physical = *unsafe { instance.enumerate_physical_devices() }.ok()?.first()?;
    let queues = [vk::DeviceQueueCreateInfo::default().queue_family_index(0).queue_priorities(&[1.0])];
    let info = vk::DeviceCreateInfo::default().queue_create_infos(&queues);
    // SAFETY: every device has a queue family 0, and `info` lives through the call.
    let device = unsafe { instance.create_device(physical, &info, None) }.ok()?;
    // SAFETY: the device was made with this queue.
    let queue = unsafe { device.get_device_queue(0, 0) };
    Some(RawDevice { entry, instance, physical, device, queue, family: 0 })
}

#[test]
fn a_program_s_own_device_draws_and_stays_its_own() {
    let Some(raw) = device() else {
        let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
        assert!(
            !required.split(',').any(|word| word.trim() == "ash"),
            "SURFEL_REQUIRE asks for ash, but has no device"
        );
        println!("skipped: no Vulkan device");
        return;
    };
    // The test keeps a clone of the loader: the renderer drops its own, and the last one unloads the functions.
    let (_entry, instance, device) = (raw.entry.clone(), raw.instance.clone(), raw.device.clone());
    // SAFETY: the handles belong together and outlive the renderer; no other thread has the queue.
    let mut renderer = unsafe { Renderer::from_raw(raw) }.unwrap();
    let z = Column3::from_f64(&[[0.0, 0.0, 1.0].into()]);
    let shape = Shape::Disks { normals: z.clone(), radii: vec![0.5] };
    let cloud = SplatCloud::new(CloudData::new([0.0; 3].into(), z, shape), OnInvalid::Refuse).unwrap().0;
    let projection = Projection::Perspective { fov_y_deg: 45.0 };
    let (eye, up, size) = ([0.0, 0.0, 5.0], [0.0, 1.0, 0.0], [8, 8]);
    let view = View::new(&Camera { eye, target: [0.0; 3], up, projection, near: 0.1, far: None, size }).unwrap();
    let resident = renderer.upload(&Scene::from(cloud)).unwrap();
    let mut frame = Frame::default();
    let stats = renderer.render_into(&resident, &view, &Settings::default(), Planes::COLOR, &mut frame).unwrap();
    assert_eq!((stats.drawn, frame.color()[36]), (1, [1.0; 4]));
    drop((resident, renderer));
    // SAFETY: the test still owns the device, and nothing is executing.
    unsafe { device.device_wait_idle() }.unwrap();
    // SAFETY: every object created from it has been destroyed.
    unsafe { device.destroy_device(None) };
    // SAFETY: its device has been destroyed.
    unsafe { instance.destroy_instance(None) };
}
