//! Runs kernels, the formulas that the tests compare, on the first available adapter.

use super::all;
use super::kernels::Kernel;
use std::fmt::Write;
use surfel_shaders::WGSL;

pub(crate) struct Device {
    device: wgpu::Device,
    queue: wgpu::Queue,
    module: wgpu::ShaderModule,
}

impl Device {
    /// Opens a device. Returns `None` and prints a line if there is no adapter and none is required.
    pub(crate) fn open() -> Option<Self> {
        let descriptor = wgpu::InstanceDescriptor::new_without_display_handle();
        let instance = wgpu::Instance::new(descriptor);
        let adapters = pollster::block_on(instance.enumerate_adapters(wgpu::Backends::all()));
        let required = std::env::var("SURFEL_REQUIRE").is_ok_and(|list| list.split(',').any(|w| w.trim() == "wgpu"));
        let Some(adapter) = adapters.first() else {
            assert!(!required, "SURFEL_REQUIRE asks for wgpu, but no adapter was found");
            println!("skipped: no adapter was found");
            return None;
        };
        let opened = pollster::block_on(adapter.request_device(&wgpu::DeviceDescriptor::default()));
        let (device, queue) = opened.unwrap();
        let source = wgpu::ShaderSource::Wgsl(text().into());
        let module = device.create_shader_module(wgpu::ShaderModuleDescriptor { label: None, source });
        Some(Self { device, queue, module })
    }

    /// Runs a kernel on the device. Returns its outputs, one sample after the other.
    pub(crate) fn run(&self, kernel: &Kernel, inputs: &[Vec<f32>]) -> Vec<f32> {
        let bytes: Vec<u8> = inputs.iter().flatten().flat_map(|v| v.to_le_bytes()).collect();
        let size = (4 * kernel.outputs * inputs.len()) as u64;
        let buffer = |size, usage| {
            self.device.create_buffer(&wgpu::BufferDescriptor { label: None, size, usage, mapped_at_creation: false })
        };
        use wgpu::BufferUsages as Usage;
        let input = buffer(bytes.len() as u64, Usage::STORAGE | Usage::COPY_DST);
        let output = buffer(size, Usage::STORAGE | Usage::COPY_SRC);
        let mapped = buffer(size, Usage::MAP_READ | Usage::COPY_DST);
        self.queue.write_buffer(&input, 0, &bytes);
        let entry = format!("kernel_{}", kernel.name.replace('/', "_"));
        let pipeline = self.device.create_compute_pipeline(&wgpu::ComputePipelineDescriptor {
            label: None,
            layout: None,
            module: &self.module,
            entry_point: Some(&entry),
            compilation_options: wgpu::PipelineCompilationOptions::default(),
            cache: None,
        });
        let entries = [&input, &output].map(wgpu::Buffer::as_entire_binding);
        let entries: Vec<_> =
            (0u32..).zip(entries).map(|(binding, resource)| wgpu::BindGroupEntry { binding, resource }).collect();
        let layout = pipeline.get_bind_group_layout(0);
        let descriptor = wgpu::BindGroupDescriptor { label: None, layout: &layout, entries: &entries };
        let group = self.device.create_bind_group(&descriptor);
        let mut encoder = self.device.create_command_encoder(&wgpu::CommandEncoderDescriptor::default());
        let mut pass = encoder.begin_compute_pass(&wgpu::ComputePassDescriptor::default());
        pass.set_pipeline(&pipeline);
        pass.set_bind_group(0, &group, &[]);
        pass.dispatch_workgroups((inputs.len() as u32).div_ceil(64), 1, 1);
        drop(pass);
        encoder.copy_buffer_to_buffer(&output, 0, &mapped, 0, size);
        self.queue.submit([encoder.finish()]);
        mapped.map_async(wgpu::MapMode::Read, .., |result| result.unwrap());
        self.device.poll(wgpu::PollType::wait_indefinitely()).unwrap();
        let view = mapped.get_mapped_range(..).unwrap();
        view.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect()
    }
}

/// Returns the WGSL text of the formulas, and of an entry point for each kernel.
fn text() -> String {
    let mut text = format!(
        "{WGSL}\n@group(0) @binding(0) var<storage, read> inputs: array<f32>;\n\
         @group(0) @binding(1) var<storage, read_write> outputs: array<f32>;\n\
         fn flag(b: bool) -> f32 {{ return select(0.0, 1.0, b); }}\n"
    );
    for kernel in all() {
        let mut body = String::new();
        for i in 0..kernel.inputs {
            writeln!(body, "    let x{i} = inputs[id.x * {}u + {i}u];", kernel.inputs).unwrap();
        }
        for line in kernel.wgsl.lines().map(str::trim).filter(|line| !line.is_empty()) {
            writeln!(body, "    {line}").unwrap();
        }
        for (i, output) in kernel.results.split(';').map(str::trim).enumerate() {
            writeln!(body, "    outputs[id.x * {}u + {i}u] = {output};", kernel.outputs).unwrap();
        }
        let name = kernel.name.replace('/', "_");
        write!(
            text,
            "@compute @workgroup_size(64)\nfn kernel_{name}(@builtin(global_invocation_id) id: vec3u) {{\n\
             if id.x >= arrayLength(&outputs) / {}u {{ return; }}\n{body}}}\n",
            kernel.outputs
        )
        .unwrap();
    }
    text
}
