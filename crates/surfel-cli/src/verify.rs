//! Option `--verify`: measures the errors of an image, and checks the promise of its preset.

use crate::failure::Failure;
use serde_json::{Value, json};
use std::fmt::Write;
use surfel_backend::{Backend, BackendOptions};
use surfel_load::info::json_number;
use surfel_metrics::{CompareOptions, Comparison, Image};
use surfel_model::{Scene, Settings};
use surfel_render::{Frame, Planes, Preset, Renderer, View};
use surfel_render::{Promise, SceneSummary, inside_surfaces};

/// Errors of an image, measured by drawing it with the reference backend.
pub(crate) struct Verified {
    backend: &'static str,
    /// Difference of the image from that of the reference backend with the same settings, in the pixels outside of the
    /// reference's decision margins.
    fidelity: Comparison,
    /// Number of pixels within the reference's decision margins (rendering model, "Ties and margins"), which aren't
    /// compared.
    left_out: usize,
    /// Error of the preset's approximations: difference between the preset and the preset `reference`, both drawn by
    /// the reference backend. `None` if the settings match no preset, or if the interior weight of a cloud is unknown.
    model: Option<Model>,
}

/// Model error of a preset: its difference from the preset `reference`.
struct Model {
    preset: Preset,
    whole: Comparison,
    /// Difference in the pixels inside surfaces ([`inside_surfaces`]); `None` if fewer than one pixel in twenty is
    /// inside, and for transparent scenes.
    inside: Option<Comparison>,
}

/// Draws the image again with the reference backend, and compares both.
///
/// `preset` is the preset whose promise applies. `drawn` is the image of `scene` that the named backend drew.
pub(crate) fn verify(
    settings: &Settings,
    preset: Option<Preset>,
    scene: &Scene,
    view: &View,
    threads: usize,
    (backend, drawn): (&'static str, &Frame),
) -> Result<Verified, Failure> {
    let options = BackendOptions::default().with_threads(threads);
    let mut reference = Backend::by_name("reference", &options)?;
    let resident = reference.upload(scene)?;
    let mut image = |settings: &Settings, planes| {
        let mut frame = Frame::default();
        reference.render_into(&resident, view, settings, planes, &mut frame)?;
        Ok::<Frame, Failure>(frame)
    };
    let same = image(settings, Planes::COLOR.with_margin(true))?;
    let mask: Vec<bool> = same.margin().iter().map(|&m| m == 0.0).collect();
    let fidelity = compare(&same, drawn, Some(&mask))?;
    // Without an interior weight, as in an octree's cloud, there are no antialiased edges to compare.
    let summary = SceneSummary::of(scene);
    let weighed = summary.without_interior_weight.is_none();
    let model = match preset.filter(|_| weighed) {
        Some(preset) => {
            let planes = Planes::COLOR.with_depth(true);
            let best = image(&Preset::Reference.apply(*settings), planes)?;
            let mask = inside_surfaces(&best).filter(|_| !summary.transparent);
            let inside = mask.map(|mask| compare(&best, &same, Some(&mask))).transpose()?;
            Some(Model { preset, whole: compare(&best, &same, None)?, inside })
        }
        None => None,
    };
    Ok(Verified { backend, fidelity, left_out: mask.iter().filter(|m| !**m).count(), model })
}

fn compare(want: &Frame, got: &Frame, mask: Option<&[bool]>) -> Result<Comparison, Failure> {
    let failed = |e: surfel_metrics::MetricsError| Failure::other(format!("the images can't be compared: {e}"));
    let image = |frame: &'_ Frame| (frame.width(), frame.height());
    let ((w, h), (gw, gh)) = (image(want), image(got));
    let a = Image::new(w, h, want.color().as_flattened()).map_err(failed)?;
    let b = Image::new(gw, gh, got.color().as_flattened()).map_err(failed)?;
    surfel_metrics::compare(&a, &b, &CompareOptions { mask, ..CompareOptions::default() }).map_err(failed)
}

impl Verified {
    /// Returns a description of each measured error that exceeds what the preset promises; empty if there is no model
    /// error.
    fn broken(&self) -> Vec<String> {
        let Some(Model { preset, whole, inside }) = &self.model else { return Vec::new() };
        let Promise { fidelity_db, model_db, inside_db, .. } = preset.promise();
        let short = |what: &str, db: f64, least: f64| {
            (db.is_nan() || db < least)
                .then(|| format!("{what} is {db:.2} dB, preset {} promises at least {least}", preset.name()))
        };
        let inside = inside.as_ref().and_then(|c| short("model error inside of surfaces", c.psnr, inside_db));
        [short("fidelity", self.fidelity.psnr, fidelity_db), short("model error", whole.psnr, model_db), inside]
            .into_iter()
            .flatten()
            .collect()
    }

    /// Fails with exit code 5 if a measured error exceeds the accuracy that the preset guarantees ([`Promise`]).
    /// Succeeds if there is no model error to judge, as without a preset.
    pub(crate) fn judge(&self) -> Result<(), Failure> {
        let broken = self.broken();
        if broken.is_empty() { Ok(()) } else { Err(Failure::threshold(broken.join("; "))) }
    }

    /// Formats the errors as text.
    pub(crate) fn text(&self) -> String {
        let mut text = String::new();
        let metrics = |c: &Comparison| {
            let flip = c.flip_mean.unwrap_or(f64::NAN);
            format!("max_abs {:.6}, rmse {:.6}, psnr {:.2} dB, flip {flip:.6}", c.max_abs, c.rmse, c.psnr)
        };
        // Writing to a string can't fail.
        let _ = writeln!(text, "fidelity  {}", metrics(&self.fidelity));
        let _ = writeln!(
            text,
            "          backend {} against reference, same settings; {} of {} pixels are within decision margins, left \
             out",
            self.backend,
            self.left_out,
            self.fidelity.compared + self.left_out
        );
        if let Some(Model { preset, whole, inside }) = &self.model {
            let Promise { fidelity_db, model_db, inside_db, .. } = preset.promise();
            let _ = writeln!(text, "model     {}", metrics(whole));
            let _ =
                writeln!(text, "          preset {} against preset reference, both by the reference", preset.name());
            if let Some(inside) = inside {
                let of = whole.compared;
                let _ = writeln!(text, "inside    {}", metrics(inside));
                let _ = writeln!(
                    text,
                    "          the same of the {} of {of} pixels inside of surfaces: none of the eight neighbours is \
                     empty or at another depth",
                    inside.compared
                );
            }
            let kept = if self.broken().is_empty() { "kept" } else { "BROKEN" };
            let _ = writeln!(
                text,
                "promise   preset {}: fidelity at least {fidelity_db} dB, model error at least {model_db} dB, \
                 {inside_db} dB inside of surfaces: {kept}",
                preset.name()
            );
        }
        text
    }

    /// Returns the errors as JSON.
    pub(crate) fn json(&self) -> Value {
        let metrics = |c: &Comparison| {
            json!({ "max_abs": json_number(c.max_abs), "rmse": json_number(c.rmse), "psnr": json_number(c.psnr),
                    "flip": json_number(c.flip_mean.unwrap_or(f64::NAN)) })
        };
        json!({
            "fidelity": metrics(&self.fidelity),
            "left_out": self.left_out,
            "model": self.model.as_ref().map(|m| metrics(&m.whole)),
            "inside": self.model.as_ref().and_then(|m| m.inside.as_ref()).map(metrics),
            "promise_kept": self.model.as_ref().map(|_| self.broken().is_empty()),
        })
    }
}
