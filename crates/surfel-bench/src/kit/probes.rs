//! Probes of the device's peak rates: memory, arithmetic in compute and fragment shaders, small quads, atomics, and the
//! renderers' fill rates.

use std::sync::mpsc;
use std::time::Instant;

use surfel_backend::{Backend, BackendOptions};
use surfel_render::Renderer;

use super::record::{Probe, Record, Writer};
use super::{On, fits};
use crate::Failure;

/// Side of the render target in pixels; the same constant is in `probes.wgsl`.
const SIDE_PX: u32 = 1024;
/// Number of invocations per workgroup; the same constant is in `probes.wgsl`.
const WORKGROUP: u64 = 256;
/// Number of vectors that an invocation of `memory_read` reads; the same constant is in `probes.wgsl`.
const READS: u64 = 64;
/// Number of floating-point operations per invocation of the arithmetic kernels. It is the product of `ROUNDS` in
/// `probes.wgsl`, four vectors of four lanes, and two operations (a multiplication and an addition).
const ARITHMETIC_FLOPS: f64 = 256.0 * 16.0 * 2.0;
/// Size of a vector of four f32, in bytes.
const VECTOR: u64 = 16;
/// Number of words that the probe `atomic maxima` modifies: one per pixel of the render target.
const COUNTERS: u64 = SIDE_PX as u64 * SIDE_PX as u64;

/// Size in bytes of each of the two buffers of the memory probes, larger than any cache; less on devices with smaller
/// limits.
const BYTES: u64 = 512 << 20;
/// Size in bytes of each of the two buffers of the memory probes with `--small`.
const SMALL_BYTES: u64 = 8 << 20;
/// Number of invocations in a run of the arithmetic probe in compute shaders, and of the probe of atomics. It is
/// limited to the number of vectors in a buffer of the memory probes.
const INVOCATIONS: u64 = 8 << 20;
/// Number of invocations in a run of the arithmetic probe in compute shaders, and of the probe of atomics, with
/// `--small`.
const SMALL_INVOCATIONS: u64 = 16 << 10;
/// Number of full-screen triangles that a run of the probe of fragment arithmetic draws.
const LAYERS: u32 = 2;
/// Number of quads, each a pixel large, that a run of the probes of small quads draws.
const QUADS: u32 = 4 << 20;
/// Number of quads that a run of the probes of small quads draws with `--small`.
const SMALL_QUADS: u32 = 64 << 10;
/// Side of the target of fragment arithmetic with `--small`, in pixels.
const SMALL_SIDE_PX: u32 = 64;

/// Number of runs of each probe, of which the fastest counts.
const RUNS: usize = 5;

/// Commands that a run of a probe records.
#[derive(Clone, Copy)]
enum Work {
    /// Dispatch of a compute shader.
    Compute { entry: &'static str, invocations: u64 },
    /// Draw with a vertex and a fragment shader, numbers of vertices and instances, topology, and the side of the drawn
    /// part of the target.
    Draw { entries: [&'static str; 2], vertices: u32, instances: u32, strip: bool, side_px: u32 },
}

/// Probe: its name, its unit, and the amount of work of one run in this unit.
struct Task {
    name: &'static str,
    unit: &'static str,
    amount: f64,
    work: Work,
}

fn tasks(small: bool, bytes: u64) -> Vec<Task> {
    let vectors = bytes / VECTOR;
    let invocations = if small { SMALL_INVOCATIONS } else { INVOCATIONS }.min(vectors);
    let quads = if small { SMALL_QUADS } else { QUADS };
    let side_px = if small { SMALL_SIDE_PX } else { SIDE_PX };
    let fragments = f64::from(side_px) * f64::from(side_px) * f64::from(LAYERS);
    let compute = |entry, invocations| Work::Compute { entry, invocations };
    let task = |name, unit, amount, work| Task { name, unit, amount, work };
    let full = ["full_vertex", "arithmetic_fragment"];
    let draw =
        |entries, vertices, instances, strip, side_px| Work::Draw { entries, vertices, instances, strip, side_px };
    let quad = |vertex| [vertex, "plain_fragment"];
    vec![
        task("memory copy", "byte", 2.0 * bytes as f64, compute("memory_copy", vectors)),
        task("memory read", "byte", bytes as f64, compute("memory_read", vectors / READS)),
        task("memory write", "byte", bytes as f64, compute("memory_write", vectors)),
        task(
            "f32 arithmetic, compute",
            "flop",
            invocations as f64 * ARITHMETIC_FLOPS,
            compute("arithmetic_compute", invocations),
        ),
        task("f32 arithmetic, fragments", "flop", fragments * ARITHMETIC_FLOPS, draw(full, 3, LAYERS, false, side_px)),
        task("quads of a pixel, strips", "quad", quads.into(), draw(quad("strip_vertex"), 4, quads, true, SIDE_PX)),
        task("quads of a pixel, list", "quad", quads.into(), draw(quad("list_vertex"), 6 * quads, 1, false, SIDE_PX)),
        task("atomic maxima", "atomic", invocations as f64, compute("atomic_maxima", invocations)),
    ]
}

/// Runs all probes, and writes each rate as soon as it is known.
pub(super) fn run(on: &On) -> Result<(), Failure> {
    let mut writer = Writer::open(&on.out)?;
    let mut write = |probe: Probe| {
        println!("{}: {}: {:.4e} {}/s", probe.backend, probe.name, probe.per_s, probe.unit);
        writer.write(&Record::Probe(probe))
    };
    let mut failures = Vec::new();
    match Device::open(on) {
        Ok(device) => {
            for task in tasks(on.small, device.bytes) {
                match device.rate(&task) {
                    Ok(per_s) => write(device.probe(&task, per_s))?,
                    Err(error) => failures.push(format!("{}: {error}", task.name)),
                }
            }
        }
        Err(error) => failures.push(error.to_string()),
    }
    for name in ["ash", "wgpu"] {
        let options = BackendOptions::default().with_adapter(on.adapter.clone());
        let side_px = if on.small { SMALL_SIDE_PX } else { SIDE_PX };
        let rates = Backend::by_name(name, &options).map_err(Failure::from).and_then(|mut backend| {
            let rates = crate::measure::fill_rates(&mut backend, side_px)?;
            Ok((backend.info().adapter.clone(), backend.is_software(), rates))
        });
        match rates {
            Ok((adapter, is_software, rates)) => {
                for rate in rates {
                    let (backend, adapter, unit) = (name.to_owned(), adapter.clone(), "fragment".to_owned());
                    let name = format!("fill: {}", rate.name);
                    write(Probe { backend, adapter, is_software, name, unit, per_s: rate.fragments_per_s })?;
                }
            }
            Err(error) => failures.push(format!("fill rates of {name}: {error}")),
        }
    }
    failures.iter().for_each(|failure| println!("FAILED: {failure}"));
    if failures.is_empty() { Ok(()) } else { Err(format!("{} probes failed", failures.len()).into()) }
}

/// Device that wgpu opens, with the buffers and the target of the probes.
struct Device {
    device: wgpu::Device,
    queue: wgpu::Queue,
    info: wgpu::AdapterInfo,
    module: wgpu::ShaderModule,
    layout: wgpu::BindGroupLayout,
    group: wgpu::BindGroup,
    #[cfg_attr(not(test), expect(dead_code, reason = "tests read what kernels write"))]
    sink: wgpu::Buffer,
    target: wgpu::TextureView,
    /// Size of each of the two large buffers, in bytes.
    bytes: u64,
}

const TARGET: wgpu::TextureFormat = wgpu::TextureFormat::Rgba8Unorm;

impl Device {
    fn open(on: &On) -> Result<Self, Failure> {
        let mut descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        descriptor.flags = wgpu::InstanceFlags::empty();
        let instance = wgpu::Instance::new(descriptor);
        let mut adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::PRIMARY));
        adapters.retain(|adapter| fits(on, &adapter.get_info().name));
        adapters.sort_by_key(|adapter| match adapter.get_info().device_type {
            wgpu::DeviceType::DiscreteGpu => 0,
            wgpu::DeviceType::IntegratedGpu => 1,
            wgpu::DeviceType::VirtualGpu => 2,
            wgpu::DeviceType::Other => 3,
            wgpu::DeviceType::Cpu => 4,
        });
        let adapter = adapters.first().ok_or("no adapter was found by wgpu; install a graphics driver")?;
        let limits = adapter.limits();
        let largest = limits.max_storage_buffer_binding_size.min(limits.max_buffer_size);
        let wanted = if on.small { SMALL_BYTES } else { BYTES };
        let bytes = wanted.min(largest) / (VECTOR * READS * WORKGROUP) * (VECTOR * READS * WORKGROUP);
        let (device, queue) = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor {
            label: Some("probes"),
            required_features: adapter.features() & wgpu::Features::TIMESTAMP_QUERY,
            required_limits: limits,
            ..wgpu::DeviceDescriptor::default()
        }))?;
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor {
            label: Some("probes"),
            source: wgpu::ShaderSource::Wgsl(include_str!("probes.wgsl").into()),
        });
        let stages = wgpu::ShaderStages::COMPUTE | wgpu::ShaderStages::FRAGMENT;
        let entry = |binding, visibility, read_only| wgpu::BindGroupLayoutEntry {
            binding,
            visibility,
            ty: wgpu::BindingType::Buffer {
                ty: wgpu::BufferBindingType::Storage { read_only },
                has_dynamic_offset: false,
                min_binding_size: None,
            },
            count: None,
        };
        let compute = wgpu::ShaderStages::COMPUTE;
        let layout = device.create_bind_group_layout(&wgpu::BindGroupLayoutDescriptor {
            label: Some("probes"),
            entries: &[entry(0, stages, true), entry(1, compute, false), entry(2, compute, false)],
        });
        let buffer = |label, size| {
            let usage = wgpu::BufferUsages::STORAGE | wgpu::BufferUsages::COPY_SRC | wgpu::BufferUsages::COPY_DST;
            device.create_buffer(&wgpu::BufferDescriptor { label: Some(label), size, usage, mapped_at_creation: false })
        };
        let (source, sink) = (buffer("source", bytes), buffer("sink", bytes));
        let counters = buffer("counters", 4 * COUNTERS);
        // Factors and summands of the arithmetic chains, chosen so that values stay near 1.
        let start: [f32; 8] = [0.999, 0.998, 0.997, 0.996, 0.001, 0.002, 0.003, 0.004];
        queue.write_buffer(&source, 0, &start.map(f32::to_le_bytes).concat());
        let group = device.create_bind_group(&wgpu::BindGroupDescriptor {
            label: Some("probes"),
            layout: &layout,
            entries: &[&source, &sink, &counters].map(wgpu::Buffer::as_entire_binding).map({
                let mut binding = 0;
                move |resource| {
                    binding += 1;
                    wgpu::BindGroupEntry { binding: binding - 1, resource }
                }
            }),
        });
        let target = device.create_texture(&wgpu::TextureDescriptor {
            label: Some("target"),
            size: wgpu::Extent3d { width: SIDE_PX, height: SIDE_PX, depth_or_array_layers: 1 },
            mip_level_count: 1,
            sample_count: 1,
            dimension: wgpu::TextureDimension::D2,
            format: TARGET,
            usage: wgpu::TextureUsages::RENDER_ATTACHMENT,
            view_formats: &[],
        });
        let target = target.create_view(&wgpu::TextureViewDescriptor::default());
        let info = adapter.get_info();
        Ok(Self { device, queue, info, module, layout, group, sink, target, bytes })
    }

    fn probe(&self, task: &Task, per_s: f64) -> Probe {
        Probe {
            backend: "wgpu".to_owned(),
            adapter: self.info.name.clone(),
            is_software: self.info.device_type == wgpu::DeviceType::Cpu,
            name: task.name.to_owned(),
            unit: task.unit.to_owned(),
            per_s,
        }
    }

    /// Returns the best rate of several runs, per second. Times come from the device's timestamps if it has them.
    fn rate(&self, task: &Task) -> Result<f64, Failure> {
        let scope = self.device.push_error_scope(wgpu::ErrorFilter::Validation);
        let pipeline = self.pipeline(task.work);
        if let Some(error) = pollster::block_on(scope.pop()) {
            return Err(error.to_string().into());
        }
        let mut best = f64::INFINITY;
        for _ in 0..RUNS {
            best = best.min(self.seconds(task.work, &pipeline)?);
        }
        Ok(task.amount / best)
    }

    fn pipeline(&self, work: Work) -> Pipeline {
        let layout = self.device.create_pipeline_layout(&wgpu::PipelineLayoutDescriptor {
            label: Some("probe"),
            bind_group_layouts: &[Some(&self.layout)],
            immediate_size: 0,
        });
        let (module, layout) = (&self.module, Some(&layout));
        let compilation_options = wgpu::PipelineCompilationOptions::default();
        match work {
            Work::Compute { entry, .. } => {
                Pipeline::Compute(self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
                    label: Some(entry),
                    layout,
                    module,
                    entry_point: Some(entry),
                    compilation_options,
                    cache: None,
                }))
            }
            Work::Draw { entries: [vertex, fragment], strip, .. } => {
                use wgpu::PrimitiveTopology::{TriangleList, TriangleStrip};
                let topology = if strip { TriangleStrip } else { TriangleList };
                Pipeline::Draw(self.device.create_render_pipeline(&wgpu::RenderPipelineDescriptor {
                    label: Some(vertex),
                    layout,
                    vertex: wgpu::VertexState {
                        module,
                        entry_point: Some(vertex),
                        compilation_options: compilation_options.clone(),
                        buffers: &[],
                    },
                    primitive: wgpu::PrimitiveState { topology, ..wgpu::PrimitiveState::default() },
                    depth_stencil: None,
                    multisample: wgpu::MultisampleState::default(),
                    fragment: Some(wgpu::FragmentState {
                        module,
                        entry_point: Some(fragment),
                        compilation_options,
                        targets: &[Some(TARGET.into())],
                    }),
                    multiview_mask: None,
                    cache: None,
                }))
            }
        }
    }

    /// Returns the time of one run, in seconds.
    fn seconds(&self, work: Work, pipeline: &Pipeline) -> Result<f64, Failure> {
        let has_clock = self.device.features().contains(wgpu::Features::TIMESTAMP_QUERY);
        let set = has_clock.then(|| {
            let (label, ty) = (Some("times"), wgpu::QueryType::Timestamp);
            self.device.create_query_set(&wgpu::QuerySetDescriptor { label, ty, count: 2 })
        });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        match (work, pipeline) {
            (Work::Compute { invocations, .. }, Pipeline::Compute(pipeline)) => {
                let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor {
                    label: Some("probe"),
                    timestamp_writes: set.as_ref().map(|query_set| wgpu::ComputePassTimestampWrites {
                        query_set,
                        beginning_of_pass_write_index: Some(0),
                        end_of_pass_write_index: Some(1),
                    }),
                });
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &self.group, &[]);
                let groups = invocations.div_ceil(WORKGROUP);
                // Devices support at most 65535 workgroups along an axis.
                let rows = groups.div_ceil(32768);
                pass.dispatch_workgroups(groups.div_ceil(rows) as u32, rows as u32, 1);
            }
            (Work::Draw { vertices, instances, side_px, .. }, Pipeline::Draw(pipeline)) => {
                let ops =
                    wgpu::Operations { load: wgpu::LoadOp::Clear(wgpu::Color::BLACK), store: wgpu::StoreOp::Store };
                let mut pass = encoder.begin_render_pass(&wgpu::RenderPassDescriptor {
                    label: Some("probe"),
                    color_attachments: &[Some(wgpu::RenderPassColorAttachment {
                        view: &self.target,
                        depth_slice: None,
                        resolve_target: None,
                        ops,
                    })],
                    timestamp_writes: set.as_ref().map(|query_set| wgpu::RenderPassTimestampWrites {
                        query_set,
                        beginning_of_pass_write_index: Some(0),
                        end_of_pass_write_index: Some(1),
                    }),
                    ..wgpu::RenderPassDescriptor::default()
                });
                pass.set_pipeline(pipeline);
                pass.set_bind_group(0, &self.group, &[]);
                let side = side_px as f32;
                pass.set_viewport(0.0, 0.0, side, side, 0.0, 1.0);
                pass.draw(0..vertices, 0..instances);
            }
            _ => return Err("the pipeline is of another probe".into()),
        }
        let resolved = set.map(|set| {
            let usage = wgpu::BufferUsages::QUERY_RESOLVE | wgpu::BufferUsages::COPY_SRC;
            let (label, mapped_at_creation) = (Some("ticks"), false);
            let buffer =
                self.device.create_buffer(&wgpu::BufferDescriptor { label, size: 16, usage, mapped_at_creation });
            encoder.resolve_query_set(&set, 0..2, &buffer, 0);
            buffer
        });
        let start = Instant::now();
        self.queue.submit([encoder.finish()]);
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        let wall_s = start.elapsed().as_secs_f64();
        let Some(buffer) = resolved else { return Ok(wall_s) };
        let bytes = self.read(&buffer, 16)?;
        let tick = |at: usize| bytes.get(at..at + 8).and_then(|b| b.try_into().ok()).map_or(0, u64::from_le_bytes);
        let ticks = tick(8).saturating_sub(tick(0));
        // Some drivers report zero ticks.
        if ticks == 0 {
            return Ok(wall_s);
        }
        Ok(ticks as f64 * f64::from(self.queue.get_timestamp_period()) * 1e-9)
    }

    /// Reads the first `size` bytes of a buffer.
    fn read(&self, buffer: &wgpu::Buffer, size: u64) -> Result<Vec<u8>, Failure> {
        let usage = wgpu::BufferUsages::MAP_READ | wgpu::BufferUsages::COPY_DST;
        let (label, mapped_at_creation) = (Some("readback"), false);
        let copy = self.device.create_buffer(&wgpu::BufferDescriptor { label, size, usage, mapped_at_creation });
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        encoder.copy_buffer_to_buffer(buffer, 0, &copy, 0, size);
        self.queue.submit([encoder.finish()]);
        let (sender, receiver) = mpsc::channel();
        copy.map_async(wgpu::MapMode::Read, .., move |result| {
            // If waiting failed, nothing receives the result.
            let _ = sender.send(result);
        });
        self.device.poll(wgpu::PollType::wait_indefinitely())?;
        receiver.recv()??;
        Ok(copy.get_mapped_range(..)?.to_vec())
    }
}

/// Pipeline of a probe.
enum Pipeline {
    Compute(wgpu::ComputePipeline),
    Draw(wgpu::RenderPipeline),
}

#[cfg(test)]
mod tests {
    use super::*;

    fn floats(bytes: &[u8]) -> Vec<f32> {
        bytes.chunks_exact(4).map(|b| f32::from_le_bytes(b.try_into().unwrap())).collect()
    }

    #[test]
    fn kernels_do_the_work_that_is_counted_and_every_probe_runs() {
        let on = On { out: "unused".into(), adapter: None, small: true };
        let device = match Device::open(&on) {
            Ok(device) => device,
            Err(error) => {
                let required = std::env::var("SURFEL_REQUIRE").unwrap_or_default();
                assert!(!required.split(',').any(|word| word.trim() == "wgpu"), "{error}");
                println!("skipped: {error}");
                return;
            }
        };
        let tasks = tasks(true, device.bytes);
        for task in &tasks {
            let per_s = device.rate(task).unwrap();
            assert!(per_s > 0.0 && per_s.is_finite(), "{}: {per_s}", task.name);
        }
        let result = |name: &str| {
            let task = tasks.iter().find(|task| task.name == name).unwrap();
            device.seconds(task.work, &device.pipeline(task.work)).unwrap();
            floats(&device.read(&device.sink, 64).unwrap())
        };
        assert_eq!(result("memory write")[4..8], [1.0, 1.0, 2.0, 3.0]);
        // Expected result: as many fused multiply-adds as are counted, in four chains with seeds 1 apart. The fifth
        // float belongs to the second invocation.
        let rounds = (ARITHMETIC_FLOPS / 32.0) as usize;
        let chain = |seed: f64| (0..rounds).fold(seed, |value, _| value * f64::from(0.999f32) + f64::from(0.001f32));
        let wanted: f64 = (0..4).map(|k| chain(1.0 / 1024.0 + f64::from(k))).sum();
        let got = f64::from(result("f32 arithmetic, compute")[4]);
        assert!((got / wanted - 1.0).abs() < 1e-5, "{got}, expected {wanted}");
        // The source is zero except for its first two vectors.
        assert_eq!(result("memory read")[..8], [0.999, 0.998, 0.997, 0.996, 0.001, 0.002, 0.003, 0.004]);
        assert_eq!(result("memory copy")[..4], [0.999, 0.998, 0.997, 0.996]);
    }
}
