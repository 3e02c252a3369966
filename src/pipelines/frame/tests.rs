//! Whole pipelines, step by step: errors and panics leave them usable.

use std::marker::PhantomData;
use std::ops::Range;

use super::*;
use crate::image::{BandMut, Image};
use crate::kernels::judge::{innovation, neighborhood};
use crate::pipelines::{bmfr, recirculation, svgf, taa, upscaler};
use crate::rows::{self, Kernel, Simd};

const SIZE: Size = Size {
    height: 37,
    width: 45,
};

/// A frame's buffers, pixel by pixel.
struct Buffers {
    color: Vec<f32>,
    albedo: Vec<f32>,
    normal: Vec<f32>,
    depth: Vec<f32>,
    motion: Vec<f32>,
    ids: Vec<u32>,
}

impl Buffers {
    fn new(number: usize) -> Self {
        let noise = |i: usize| ((i * 2_654_435_761 + number * 977) % 1009) as f32 / 1009.0;
        let n = SIZE.pixels();
        Self {
            color: (0..3 * n).map(noise).collect(),
            albedo: (0..3 * n).map(|i| 0.2 + 0.6 * noise(i / 24)).collect(),
            normal: (0..3 * n).map(|i| [0.1, 0.2, 1.0][i % 3]).collect(),
            depth: (0..n).map(|i| 1.0 + 0.01 * noise(i / 9)).collect(),
            motion: (0..3 * n).map(|i| [0.75, -1.5, 0.0][i % 3]).collect(),
            ids: (0..n).map(|i| (i % 45 / 20) as u32).collect(),
        }
    }

    fn frame(&self) -> Frame<'_> {
        let view = |channels, data| Some(Pixels::interleaved(SIZE, channels, data).expect("fits"));
        Frame {
            albedo: view(3, &self.albedo),
            surface: Surface {
                depth: view(1, &self.depth),
                normal: view(3, &self.normal),
                ids: Some(Pixels::interleaved(SIZE, 1, &self.ids).expect("fits")),
                ..Default::default()
            },
            motion: view(3, &self.motion),
            camera: Some(camera()),
            ..Frame::new(view(3, &self.color).expect("given"))
        }
    }
}

fn camera() -> Camera {
    let matrix = [
        [1.0, 0.0, 0.0, 0.0],
        [0.0, 1.0, 0.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
        [0.0, 0.0, 1.0, 0.0],
    ];
    Camera::new(matrix, SIZE).expect("a projection")
}

fn svgf() -> svgf::Svgf {
    svgf::Svgf::new(svgf::Params::default()).expect("in range")
}

/// The bits of some frames' results.
fn bits(pipeline: &mut impl Pipeline, frames: impl IntoIterator<Item = usize>) -> Vec<u32> {
    let mut results = Results::new(pipeline, SIZE).expect("a size");
    let mut bits = vec![];
    for number in frames {
        let buffers = Buffers::new(number);
        let step = pipeline.step(&buffers.frame(), results.output());
        step.expect("a whole frame");
        let more = results.history_length.iter().chain(&results.confidence);
        bits.extend(results.color.iter().chain(more).map(|v| v.to_bits()));
    }
    bits
}

#[test]
fn every_pipeline_runs_by_default() {
    fn runs(mut pipeline: impl Pipeline) {
        bits(&mut pipeline, 0..3);
    }
    runs(svgf());
    runs(svgf::Svgf::new(svgf::Params::textbook()).expect("in range"));
    let half_res = svgf::Params::half_res(0.3, 2);
    runs(svgf::Svgf::new(half_res).expect("in range"));
    runs(bmfr::Bmfr::new(bmfr::Params::default()).expect("in range"));
    runs(taa::Taa::new(taa::Params::default()).expect("in range"));
    let params = recirculation::Params::default();
    runs(recirculation::Recirculation::new(params).expect("in range"));
    runs(upscaler::Upscaler::new(upscaler::Params::default()).expect("in range"));
}

#[test]
fn what_users_derive_from_can_be_shown_and_compared() {
    let wrong = svgf::Params {
        tap_exposure: -1.0,
        ..Default::default()
    };
    assert_ne!(wrong, svgf::Params::default());
    let error = svgf::Svgf::new(wrong).unwrap_err();
    assert!(error.to_string().starts_with("tap_exposure: "));
    assert!(format!("{:?}", svgf()).starts_with("Svgf { params: Params { "));
    let buffers = Buffers::new(0);
    let shown = format!("{:?}", buffers.frame());
    assert!(
        shown.starts_with("Frame { color: Pixels { size: "),
        "{shown}"
    );
    assert!(shown.len() < 2000, "elements are not shown: {shown}");
}

#[test]
fn frames_in_planes_give_the_same_bits() {
    let [mut one, mut other] = [svgf(), svgf()];
    let expected = bits(&mut one, 0..3);
    let mut results = Results::new(&other, SIZE).expect("a size");
    let mut got = vec![];
    for number in 0..3 {
        let buffers = Buffers::new(number);
        let frame = buffers.frame();
        let planes = [
            Some(frame.color),
            frame.albedo,
            frame.surface.normal,
            frame.motion,
        ];
        let planes = planes.map(|buffer| buffer.expect("given").to_planes());
        let [color, albedo, normal, motion] = planes.each_ref().map(Image::pixels);
        let frame = Frame {
            color,
            albedo: Some(albedo),
            motion: Some(motion),
            surface: Surface {
                normal: Some(normal),
                ..frame.surface
            },
            ..frame
        };
        other.step(&frame, results.output()).expect("a whole frame");
        let more = results.history_length.iter().chain(&results.confidence);
        got.extend(results.color.iter().chain(more).map(|v| v.to_bits()));
    }
    assert!(expected == got);
}

#[test]
fn what_does_not_fit_is_an_error() {
    let buffers = Buffers::new(0);
    let whole = buffers.frame();
    let small = Size {
        height: SIZE.height - 1,
        ..SIZE
    };
    let short = vec![0.5; 3 * small.pixels()];
    let small_image = Pixels::interleaved(small, 3, &short).ok();
    let flat = whole.surface.depth;
    let with = |surface| Frame { surface, ..whole };
    let camera = Camera::new(camera().world_to_clip, small).ok();
    let frames = [
        (
            "albedo: expected height 37 and width 45, got height 36 and width 45",
            Frame {
                albedo: small_image,
                ..whole
            },
        ),
        (
            "color: expected 3 channels, got 1",
            Frame::new(flat.expect("given")),
        ),
        (
            "motion: expected 2 or 3 channels, got 1",
            Frame {
                motion: flat,
                ..whole
            },
        ),
        (
            "depth: expected 1 channel, got 3",
            with(Surface {
                depth: whole.albedo,
                ..whole.surface
            }),
        ),
        (
            "normal: expected 3 channels, got 1",
            with(Surface {
                normal: flat,
                ..whole.surface
            }),
        ),
        ("camera: expected height 37", Frame { camera, ..whole }),
        (
            "jitter: expected offsets",
            Frame {
                jitter: Some([0.0, f64::NAN]),
                ..whole
            },
        ),
    ];
    let mut pipeline = svgf();
    let mut results = Results::new(&pipeline, SIZE).expect("a size");
    bits(&mut pipeline, 0..2);
    for (message, frame) in frames {
        let error = pipeline.step(&frame, results.output()).err();
        let error = error.expect(message).to_string();
        assert!(error.starts_with(message), "{error}");
    }
    let outputs: [(&str, fn(&mut Output)); 4] = [
        ("color: expected 4995 elements", |output| {
            output.color = &mut []
        }),
        ("rejection: expected 1665 elements", |output| {
            output.rejection = &mut []
        }),
        ("variance: expected Some, got None", |output| {
            output.variance = None
        }),
        ("choice: expected Some, got None", |output| {
            output.choice = None
        }),
    ];
    for (message, spoil) in outputs {
        let mut output = results.output();
        spoil(&mut output);
        let error = pipeline.step(&whole, output).err();
        let error = error.expect(message).to_string();
        assert!(error.starts_with(message), "{error}");
    }
    // A sequence of one size, and after errors as if nothing had been.
    let other = Frame::new(small_image.expect("fits"));
    let mut smaller = Results::new(&pipeline, small).expect("a size");
    assert!(pipeline.step(&other, smaller.output()).is_err());
    assert!(bits(&mut pipeline, [2]) == bits(&mut svgf(), 0..3)[2 * 5 * SIZE.pixels()..]);
}

#[test]
fn data_of_another_length_are_no_view() {
    let [zero, line] = [0, 1].map(|height| Size { height, width: 4 });
    assert!(Pixels::interleaved(line, 3, &[0.0; 12]).is_ok());
    assert!(Pixels::interleaved(line, 3, &[0.0; 11]).is_err());
    assert!(Pixels::<f32>::interleaved(zero, 3, &[]).is_err());
    assert!(Pixels::<f32>::interleaved(line, 0, &[]).is_err());
    assert!(crate::View::planar(line, 2, &[0.0; 9]).is_err());
    assert!(crate::PixelsMut::interleaved(line, 2, &mut [0.0; 9]).is_err());
    let huge = Size {
        height: usize::MAX,
        width: usize::MAX,
    };
    assert!(Pixels::interleaved(huge, 3, &[0.0]).is_err());
    assert!(Image::<f32>::zeros(huge, 1).is_err());
    assert!(Results::new(&svgf(), huge).is_err());
}

#[test]
fn parameters_out_of_range_are_errors() {
    fn refused(made: Result<impl Sized>, message: &str) {
        let error = made.err().expect(message).to_string();
        assert_eq!(error, message);
    }
    let svgf = |spoil: fn(&mut svgf::Params)| {
        let mut params = svgf::Params::default();
        spoil(&mut params);
        svgf::Svgf::new(params)
    };
    let iterations = svgf(|params| params.atrous.iterations = 17);
    refused(iterations, "iterations: expected 0 to 16 passes, got 17");
    let radius = svgf(|params| params.atrous.radius = 0);
    refused(radius, "radius: expected 1 or 2 taps, got 0");
    let radius = svgf(|params| params.variance.radius = usize::MAX);
    let message = format!("radius: expected 0 to 16 pixels, got {}", usize::MAX);
    refused(radius, &message);
    let levels = svgf(|params| {
        params.history.innovation = Some(innovation::Params {
            levels: 9,
            ..Default::default()
        });
    });
    refused(levels, "levels: expected 1 to 8, got 9");
    let window = svgf(|params| {
        let clip = neighborhood::Params {
            radius: 3,
            ..taa::Params::DENOISED.clip
        };
        params.antialias = Some(taa::Params {
            clip,
            ..taa::Params::DENOISED
        });
    });
    refused(window, "window: expected a radius of 1 or 2, got 3");
    let params = bmfr::Params {
        block: Some(3),
        ..Default::default()
    };
    let message = "block: expected 4 to 256 pixels, got 3";
    refused(bmfr::Bmfr::new(params), message);
    let mut params = recirculation::Params::default();
    params.pull_push.factor = 1;
    let made = recirculation::Recirculation::new(params);
    refused(made, "factor: expected 2 to 16, got 1");
}

/// SVGF with a kernel that panics.
struct Breaking {
    svgf: svgf::Svgf,
    breaks: bool,
}

struct Panics<'a>(PhantomData<&'a f32>);

impl<'a> Kernel for Panics<'a> {
    type Out = BandMut<'a>;

    fn rows<S: Simd>(&self, _: S, rows: Range<usize>, _: BandMut<'a>) {
        assert!(rows.start == 0, "a kernel that panics, on purpose");
    }
}

impl Steps for Breaking {
    fn writes(&self) -> Extras {
        self.svgf.writes()
    }

    fn upkeep(&mut self) -> &mut Upkeep {
        self.svgf.upkeep()
    }

    fn forget(&mut self) {
        self.svgf.forget();
    }

    fn next(&mut self, frame: &Frame, output: Output) -> Result<Summary> {
        let summary = self.svgf.next(frame, output);
        if self.breaks {
            let mut image = Image::new(frame.color.size, 1);
            let kernel = Panics(PhantomData);
            rows::run(&kernel, frame.color.size.height, image.bands());
        }
        summary
    }
}

#[test]
fn a_panic_in_a_kernel_leaves_a_pipeline_that_begins_anew() {
    let mut pipeline = Breaking {
        svgf: svgf(),
        breaks: false,
    };
    let mut results = Results::new(&pipeline, SIZE).expect("a size");
    let expected = bits(&mut svgf(), 0..3);
    for _ in 0..2 {
        assert!(bits(&mut pipeline, 0..3) == expected);
        pipeline.breaks = true;
        let buffers = Buffers::new(3);
        let step = AssertUnwindSafe(|| pipeline.step(&buffers.frame(), results.output()).is_ok());
        assert!(catch_unwind(step).is_err());
        pipeline.breaks = false;
    }
    assert!(bits(&mut pipeline, 0..3) == expected);
}
