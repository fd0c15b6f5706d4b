//! Step `devices` of the kit: lists the devices that each GPU backend finds.

use super::On;
use super::record::{Device, Record, Writer};
use crate::Failure;
use crate::machine::Machine;

/// Exit code for the kit's script if all devices compute on the CPU.
const SOFTWARE_ALONE: i32 = 3;
/// Exit code for the kit's script if there is no device.
const NO_DEVICE: i32 = 4;

/// Appends the machine and its devices to `results.jsonl`. If no device is a GPU, exits the process with
/// [`SOFTWARE_ALONE`] or [`NO_DEVICE`].
pub(super) fn run(on: &On) -> Result<(), Failure> {
    let mut writer = Writer::open(&on.out)?;
    writer.write(&Record::Machine(Machine::this()))?;
    let devices = all(on);
    for device in &devices {
        let kind = if device.is_software { "computes on the CPU" } else { "GPU" };
        println!("{}: {} ({}), {kind}", device.backend, device.adapter, device.driver);
        writer.write(&Record::Device(device.clone()))?;
    }
    match devices.iter().map(|device| device.is_software).min() {
        Some(false) => Ok(()),
        Some(true) => std::process::exit(SOFTWARE_ALONE),
        None => std::process::exit(NO_DEVICE),
    }
}

/// Returns the devices of every GPU backend in this build, or those whose names contain the text of `--adapter`. The
/// default device of each backend comes first.
#[cfg_attr(not(any(feature = "wgpu", feature = "ash")), allow(unused_variables, unused_mut, reason = "no GPU backend"))]
fn all(on: &On) -> Vec<Device> {
    let mut all = Vec::new();
    #[cfg(feature = "ash")]
    match surfel_ash::devices() {
        Ok(found) => all.extend(found.into_iter().filter(|found| super::fits(on, &found.name)).map(|found| Device {
            backend: "ash".to_owned(),
            adapter: found.name,
            driver: found.driver,
            is_software: found.is_software,
            facts: found.facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        })),
        Err(error) => println!("ash: {error}"),
    }
    #[cfg(feature = "wgpu")]
    {
        let found = surfel_wgpu::adapters().into_iter().filter(|found| super::fits(on, &found.name));
        let before = all.len();
        all.extend(found.map(|found| Device {
            backend: "wgpu".to_owned(),
            adapter: found.name,
            driver: format!("{}: {}", found.api, found.driver),
            is_software: found.is_software,
            facts: found.facts.into_iter().map(|(name, value)| (name.to_owned(), value)).collect(),
        }));
        if all.len() == before {
            println!("wgpu: no adapter was found");
        }
    }
    all
}
