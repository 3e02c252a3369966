//! History validation: does a tap of the previous frame show the pixel's surface, in the same light?
//!
//! The tests compare depth, normal, id and colour, each optional. Every test turns a difference into a trust: 1 up to one
//! bound, 0 beyond another, linear between; with equal bounds the threshold is hard. A tap's trust is the product.
//! - **id**: equal.
//! - **normal**: n·n′ ≥ cos(angle) · |n| |n′|, so that only the directions of normals count and zero normals pass.
//!   Normals in the object's own space, where given, are compared instead: they do not turn with it.
//! - **depth**, with Ze the depth that the surface is expected to have had (its depth plus the motion's third channel):
//!   relative, |Z′ − Ze| ≤ t·Ze; or, where the previous camera is known, by the distance of the expected point from
//!   the tap's plane, |(Xe − X′)·n′| ≤ t·Ze, which stays small on slopes where depth itself runs (NRD ReLAX and
//!   ReBLUR test the plane distance against a share of view depth; the relative test at a tenth is the usual rule of
//!   thumb). Background, of infinite depth or none above 0, matches background alone.
//! - **luminance**: |l − l′| / max(|l|, |l′|) ≤ t; missing samples pass.
//! - **speed**: the length of the motion in pixels.
//! - **motion**, for frames without depth: |m − m′| − 2c ≤ t, where m is the pixel's motion, m′ that of the tap in the previous
//!   frame, and c the least |m − m′| of all pixels that come from the tap ([`super::claims`]).

use super::spans::{Span, Spans};
use crate::error::{Error, Result, in_range};
use crate::lanes::LANES;
use crate::pixels::{MotionRun, Row};
use std::ops::Range;

use crate::image::{Pixels, Run, SEGMENT, Size};
use crate::kernels::camera::pinhole::Rays;
use crate::math::{self, dot, is_background, luminance};

/// The tests that a pixel's history failed, as bits of a mask.
pub mod rejection {
    /// The tap lies outside the previous frame.
    pub const OUTSIDE: u8 = 1;
    /// The depth differs from the expected one.
    pub const DEPTH: u8 = 2;
    /// The normal differs.
    pub const NORMAL: u8 = 4;
    /// The id differs.
    pub const ID: u8 = 8;
    /// The motion is too long.
    pub const VELOCITY: u8 = 16;
    /// The luminance differs.
    pub const LUMINANCE: u8 = 32;
    /// The surface that was there moved otherwise.
    pub const MOTION: u8 = 64;
}

/// Differences up to `full` have trust 1, differences beyond `none` have 0; the ramp between is linear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Threshold {
    /// Differences up to here are fully trusted.
    pub full: f32,
    /// Differences beyond are not trusted.
    pub none: f32,
}

impl Threshold {
    /// All or nothing.
    pub const fn hard(at: f32) -> Self {
        Self { full: at, none: at }
    }

    pub(crate) fn check(
        self,
        name: &str,
        expected: &str,
        holds: impl Fn(f32) -> bool,
    ) -> Result<()> {
        in_range(name, self.full, expected, &holds)?;
        in_range(name, self.none, expected, &holds)?;
        if self.full > self.none {
            let got = format!("({}, {})", self.full, self.none);
            return Err(Error::value(
                name,
                "a pair (full, none) with full ≤ none",
                got,
            ));
        }
        if self.full < self.none && self.none == f32::INFINITY {
            return Err(Error::value(name, "a finite second threshold", self.none));
        }
        Ok(())
    }

    /// An error if it is no threshold of luminance, which pipelines call one of albedo.
    pub(crate) fn check_luminance(self, name: &'static str) -> Result<()> {
        self.check(name, "a finite share from 0", |v| v >= 0.0 && v.is_finite())
    }

    /// The trust in a difference, with the bounds in multiples of `unit`; 0 for NaN.
    #[inline(always)]
    pub(crate) fn trust(self, difference: f32, unit: f32) -> f32 {
        self.trust_if::<true>(difference, unit)
    }

    /// [`trust`](Self::trust) without branches; hard thresholds save the ramp's division.
    #[inline(always)]
    fn trust_if<const RAMP: bool>(self, difference: f32, unit: f32) -> f32 {
        let (full, none) = (self.full * unit, self.none * unit);
        let beyond = if RAMP {
            let ramp = (none - difference) / (none - full);
            if difference < none { ramp } else { 0.0 }
        } else {
            0.0
        };
        if difference <= full { 1.0 } else { beyond }
    }

    fn is_ramp(self) -> bool {
        self.full < self.none
    }
}

/// The thresholds of the tests.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Params {
    /// Relative difference of depth; > 0; 0.1.
    pub relative_depth: Threshold,
    /// Distance from the plane, as a share of depth; > 0; 0.01.
    pub plane_distance: Threshold,
    /// Angle between normals in degrees; 0 to 180; 25. The ramp is linear in the cosine.
    pub normal_angle: Threshold,
    /// Relative difference of luminance; ≥ 0; 0.5.
    pub relative_luminance: Threshold,
    /// Length of the motion in pixels; ≥ 0; none.
    pub speed: Option<Threshold>,
    /// Difference between motions in pixels, above twice the least; ≥ 0, may be infinite; 0.2.
    pub motion_difference: Threshold,
}

impl Default for Params {
    fn default() -> Self {
        Self {
            relative_depth: Threshold::hard(0.1),
            plane_distance: Threshold::hard(0.01),
            normal_angle: Threshold::hard(25.0),
            relative_luminance: Threshold::hard(0.5),
            speed: None,
            motion_difference: Threshold::hard(0.2),
        }
    }
}

impl Params {
    /// An error if a threshold is out of range.
    pub fn check(&self) -> Result<()> {
        self.relative_depth
            .check("relative_depth", "a share above 0", |v| v > 0.0)?;
        self.plane_distance
            .check("plane_distance", "a share above 0", |v| v > 0.0)?;
        self.normal_angle
            .check("normal_angle", "degrees from 0 to 180", |v| {
                (0.0..=180.0).contains(&v)
            })?;
        self.relative_luminance
            .check_luminance("relative_luminance")?;
        if let Some(speed) = self.speed {
            speed.check("speed", "pixels from 0", |v| v >= 0.0)?;
        }
        self.motion_difference
            .check("motion_difference", "pixels from 0", |v| v >= 0.0)
    }
}

/// The guide buffers of one frame.
#[derive(Clone, Copy, Debug, Default)]
pub struct Surface<'a> {
    /// View-space z (1), +inf where nothing was hit.
    pub depth: Option<Pixels<'a>>,
    /// World space (3), unit length; zeros where nothing was hit. The tests of history compare directions alone; the filter's
    /// guide also compares lengths.
    pub normal: Option<Pixels<'a>>,
    /// Id of object, mesh or material (1).
    pub ids: Option<Pixels<'a, u32>>,
    /// Normals in the object's own space (3).
    pub object_normal: Option<Pixels<'a>>,
    /// Colour whose luminance is compared: the image, or the albedo.
    pub color: Option<Pixels<'a>>,
}

/// A buffer of the current and of the previous frame.
type Pair<'a, T = f32> = Option<[Pixels<'a, T>; 2]>;

/// The tests between two frames, as far as both have the buffers.
#[derive(Clone, Copy)]
pub struct Tests<'a> {
    depth: Pair<'a>,
    /// The normals whose directions are compared.
    direction: Pair<'a>,
    /// The previous frame's world-space normals, for the plane test, and whether `direction` holds them already.
    normal: Option<Pixels<'a>>,
    normal_is_direction: bool,
    ids: Pair<'a, u32>,
    color: Pair<'a>,
    /// What [`claims`](super::claims::claims) found.
    claims: Option<Pixels<'a>>,
    /// The previous camera's rays, where planes are tested.
    rays: Option<Rays>,
    params: Params,
    /// Bounds of the angle, as bounds of minus its cosine.
    turn: Threshold,
}

/// Line buffers: the surface that each pixel of a run should find in the previous frame.
pub(crate) struct Expected {
    depth: Row,
    /// Relative to the previous camera.
    point: [Row; 3],
    direction: [Row; 3],
    length: Row,
    id: Row<u32>,
    luminance: Row,
    motion: [Row; 2],
    /// Trust from the tests that do not depend on the tap.
    trust: Row,
}

impl Expected {
    pub fn zeroed() -> Self {
        Self {
            depth: [0.0; SEGMENT],
            point: [[0.0; SEGMENT]; 3],
            direction: [[0.0; SEGMENT]; 3],
            length: [0.0; SEGMENT],
            id: [0; SEGMENT],
            luminance: [0.0; SEGMENT],
            motion: [[0.0; SEGMENT]; 2],
            trust: [1.0; SEGMENT],
        }
    }
}

/// The square footprints of a run of pixels.
pub(crate) struct Places<'a> {
    /// Index of the upper left tap.
    pub at: &'a [u32],
    pub spans: &'a Spans,
    /// Position of the upper left tap, in index space.
    pub corner: [&'a [f32]; 2],
    /// Taps along each side.
    pub side: usize,
    /// Size of the previous frame.
    pub size: Size,
    /// Strides to the tap on the right and to the tap below.
    pub steps: [usize; 2],
}

/// A line buffer for a contiguous row of taps: those of the run, and the footprint's further columns.
type Beside<T = f32> = [T; SEGMENT + LANES];

/// Line buffers of the validation: the taps' surfaces, and the result for each tap.
pub(crate) struct Validation {
    taps: TapSurfaces,
    trust: Row,
    failed: Row<u32>,
}

/// The previous frame's surface at one tap of each pixel of a run.
struct TapSurfaces {
    ids: Beside<u32>,
    depth: Beside,
    direction: Vectors,
    normal: Vectors,
    luminance: Beside,
    claims: [Beside; 3],
    records: [[f32; 4]; SEGMENT],
}

struct Vectors {
    axes: [Beside; 3],
    lengths: Beside,
}

impl Vectors {
    fn zeroed() -> Self {
        Self {
            axes: [[0.0; _]; 3],
            lengths: [0.0; _],
        }
    }

    #[inline(always)]
    fn measure(&mut self, len: usize) {
        let [x, y, z] = self.axes.each_ref().map(|axis| &axis[..len]);
        let lengths = &mut self.lengths[..len];
        for i in 0..len {
            lengths[i] = length([x[i], y[i], z[i]]);
        }
    }
}

impl Validation {
    pub fn zeroed() -> Self {
        Self {
            taps: TapSurfaces {
                ids: [0; _],
                depth: [0.0; _],
                direction: Vectors::zeroed(),
                normal: Vectors::zeroed(),
                luminance: [0.0; _],
                claims: [[0.0; _]; 3],
                records: [[0.0; 4]; SEGMENT],
            },
            trust: [0.0; SEGMENT],
            failed: [0; SEGMENT],
        }
    }
}

impl TapSurfaces {
    /// Loads contiguous taps, or gathers scattered ones.
    #[inline(always)]
    fn load(&mut self, tests: &Tests, pixels: Addresses) {
        #[inline(always)]
        fn vectors(
            image: &Pixels,
            pixels: Addresses,
            records: &mut [[f32; 4]],
            into: [&mut [f32]; 3],
        ) -> usize {
            match pixels {
                Addresses::Contiguous(run) => image.read(run, into),
                Addresses::Scattered(at) => image.gather_vectors(at, records, into),
            }
            pixels.len()
        }
        #[inline(always)]
        fn values<T: Copy + Default>(image: &Pixels<T>, pixels: Addresses, into: &mut [T]) {
            let into = &mut into[..pixels.len()];
            match pixels {
                Addresses::Contiguous(run) => image.load(run, 0, into),
                Addresses::Scattered(at) => image.gather(at, into),
            }
        }
        let records = &mut self.records;
        if let Some([_, before]) = &tests.ids {
            values(before, pixels, &mut self.ids);
        }
        if let Some([_, before]) = &tests.depth {
            values(before, pixels, &mut self.depth);
            let depths = &mut self.depth[..pixels.len()];
            depths.iter_mut().for_each(|depth| *depth = placed(*depth));
        }
        if let Some([_, before]) = &tests.color {
            let axes = self.normal.axes.each_mut().map(Beside::as_mut_slice);
            let len = vectors(before, pixels, records, axes);
            let [r, g, b] = self.normal.axes.each_ref().map(|axis| &axis[..len]);
            for (i, lane) in self.luminance[..len].iter_mut().enumerate() {
                *lane = luminance(r[i], g[i], b[i]);
            }
        }
        if let Some([_, before]) = &tests.direction {
            let axes = self.direction.axes.each_mut().map(Beside::as_mut_slice);
            let len = vectors(before, pixels, records, axes);
            self.direction.measure(len);
        }
        if let Some(claims) = &tests.claims {
            let axes = self.claims.each_mut().map(Beside::as_mut_slice);
            vectors(claims, pixels, records, axes);
        }
        if let Some(before) = tests.plane_normal() {
            let axes = self.normal.axes.each_mut().map(Beside::as_mut_slice);
            let len = vectors(before, pixels, records, axes);
            self.normal.measure(len);
        }
    }
}

/// Where the taps lie in the previous frame.
#[derive(Clone, Copy)]
enum Addresses<'a> {
    Contiguous(Run),
    Scattered(&'a [u32]),
}

impl Addresses<'_> {
    #[inline(always)]
    fn len(self) -> usize {
        match self {
            Self::Contiguous(run) => run.len,
            Self::Scattered(at) => at.len(),
        }
    }
}

impl<'a> Tests<'a> {
    /// Tests of the buffers that both frames have. `rays` are the previous camera's, for the plane test.
    pub fn new(now: Surface<'a>, before: Surface<'a>, rays: Option<Rays>, params: &Params) -> Self {
        fn both<'a, T>(now: Option<Pixels<'a, T>>, before: Option<Pixels<'a, T>>) -> Pair<'a, T> {
            now.zip(before).map(|(now, before)| [now, before])
        }
        let minus_cosine = |angle: f32| -libm::cos(f64::from(angle).to_radians()) as f32;
        let depth = both(now.depth, before.depth);
        let normal = both(now.normal, before.normal);
        let object_normal = both(now.object_normal, before.object_normal);
        Self {
            depth,
            direction: object_normal.or(normal),
            normal: normal.map(|[_, before]| before),
            normal_is_direction: object_normal.is_none(),
            ids: both(now.ids, before.ids),
            color: both(now.color, before.color),
            claims: None,
            rays: rays.filter(|_| depth.is_some() && normal.is_some()),
            params: *params,
            turn: Threshold {
                full: minus_cosine(params.normal_angle.full),
                none: minus_cosine(params.normal_angle.none),
            },
        }
    }

    /// No test at all.
    pub fn none() -> Self {
        let nothing = Surface::default();
        Self::new(nothing, nothing, None, &Params::default())
    }

    /// The same, and the test of motion.
    pub fn with_claims(self, claims: Option<Pixels<'a>>) -> Self {
        Self { claims, ..self }
    }

    /// Names of the buffers that are compared.
    pub fn used(&self) -> Vec<&'static str> {
        [
            ("depth", self.depth.is_some()),
            ("plane", self.rays.is_some()),
            ("normal", self.normal.is_some()),
            ("object_normal", !self.normal_is_direction),
            ("ids", self.ids.is_some()),
            ("albedo", self.color.is_some()),
        ]
        .into_iter()
        .filter_map(|(name, used)| used.then_some(name))
        .collect()
    }

    /// True without any test.
    pub(crate) fn accept_all(&self) -> bool {
        let untested = self.depth.is_none() && self.direction.is_none() && self.ids.is_none();
        untested && self.color.is_none() && self.params.speed.is_none() && self.claims.is_none()
    }

    /// Loads the surfaces of a run, as they should appear in the previous frame: at index-space positions `from`, with the
    /// change of depth that `motion` gives.
    #[inline(always)]
    pub(crate) fn expect(
        &self,
        run: Run,
        from: [&[f32]; 2],
        motion: MotionRun,
        expected: &mut Expected,
    ) {
        let len = run.len;
        if let Some([now, _]) = self.depth {
            let depths = &mut expected.depth[..len];
            now.load(run, 0, depths);
            depths.iter_mut().for_each(|depth| *depth = placed(*depth));
            if let Some(change) = motion.depth {
                for (depth, change) in depths.iter_mut().zip(change) {
                    *depth += change;
                }
            }
        }
        if let Some(rays) = self.rays {
            let depth = &expected.depth[..len];
            let [px, py, pz] = expected.point.each_mut().map(|lane| &mut lane[..len]);
            let [x, y] = from.map(|lane| &lane[..len]);
            for i in 0..len {
                let point = rays.at(x[i] + 0.5, y[i] + 0.5) * depth[i];
                (px[i], py[i], pz[i]) = (point.x, point.y, point.z);
            }
        }
        if let Some([now, _]) = self.direction {
            now.read_rows(run, &mut expected.direction);
            let [x, y, z] = expected.direction.each_ref().map(|lane| &lane[..len]);
            let lengths = &mut expected.length[..len];
            for i in 0..len {
                lengths[i] = length([x[i], y[i], z[i]]);
            }
        }
        if let Some([now, _]) = self.ids {
            now.load(run, 0, &mut expected.id[..len]);
        }
        if let Some([now, _]) = self.color {
            let first = run.y * now.size.width + run.x;
            for (i, lane) in expected.luminance[..len].iter_mut().enumerate() {
                let [r, g, b] = now.vector(first + i);
                *lane = luminance(r, g, b);
            }
        }
        if self.claims.is_some() {
            let [x, y] = expected.motion.each_mut().map(|lane| &mut lane[..len]);
            x.copy_from_slice(&motion.x[..len]);
            y.copy_from_slice(&motion.y[..len]);
        }
        if let Some(speed) = self.params.speed {
            let (x, y) = (&motion.x[..len], &motion.y[..len]);
            for (i, lane) in expected.trust[..len].iter_mut().enumerate() {
                *lane = speed.trust((x[i] * x[i] + y[i] * y[i]).sqrt(), 1.0);
            }
        }
    }

    /// The normals for the plane test, where `direction` does not hold them.
    fn plane_normal(&self) -> Option<&Pixels<'a>> {
        let separate = self.rays.is_some() && !self.normal_is_direction;
        self.normal.as_ref().filter(|_| separate)
    }

    /// Validates the taps for which `chosen(row, column)` holds. For every such tap and every span of the run, `tell` gets the
    /// tap, the span, the pixels' trust in it, and the bits of the tests that leave no trust.
    #[inline(always)]
    pub(crate) fn validate(
        &self,
        expected: &Expected,
        places: Places,
        validation: &mut Validation,
        chosen: impl Fn(usize, usize) -> bool,
        tell: impl FnMut([usize; 2], Range<usize>, &[f32], &[u32]),
    ) {
        let Params {
            relative_depth,
            plane_distance,
            relative_luminance,
            motion_difference,
            ..
        } = self.params;
        let bounds = [
            relative_depth,
            plane_distance,
            relative_luminance,
            motion_difference,
            self.turn,
        ];
        match bounds.into_iter().any(Threshold::is_ramp) {
            true => self.validate_if::<true>(expected, places, validation, chosen, tell),
            false => self.validate_if::<false>(expected, places, validation, chosen, tell),
        }
    }

    #[inline(always)]
    fn validate_if<const RAMPS: bool>(
        &self,
        expected: &Expected,
        places: Places,
        validation: &mut Validation,
        chosen: impl Fn(usize, usize) -> bool,
        mut tell: impl FnMut([usize; 2], Range<usize>, &[f32], &[u32]),
    ) {
        let [across, down] = places.steps;
        let Validation {
            taps,
            trust,
            failed,
        } = validation;
        let mut indices = [0; SEGMENT];
        for Span { part, contiguous } in places.spans.iter() {
            for row in 0..places.side {
                let at = &places.at[part.clone()];
                if contiguous {
                    let first = at[0] as usize + row * down;
                    let seen = Run {
                        y: first / places.size.width,
                        x: first % places.size.width,
                        len: part.len() + places.side - 1,
                    };
                    taps.load(self, Addresses::Contiguous(seen));
                }
                for column in (0..places.side).filter(|&column| chosen(row, column)) {
                    let shift = if contiguous {
                        column
                    } else {
                        let step = (row * down + column * across) as u32;
                        for (to, at) in indices.iter_mut().zip(at) {
                            *to = at + step;
                        }
                        taps.load(self, Addresses::Scattered(&indices[..part.len()]));
                        0
                    };
                    let (trust, failed) = (&mut trust[..part.len()], &mut failed[..part.len()]);
                    let place = (places.corner, [column as f32, row as f32]);
                    self.test::<RAMPS>(expected, part.start, place, taps, shift, trust, failed);
                    tell([row, column], part.clone(), trust, failed);
                }
            }
        }
    }

    /// Tests one tap of the pixels from `start` on; its line buffers begin at `shift`. The outputs are arguments of their own,
    /// so that the compiler knows that they do not alias the inputs and vectorises the loops.
    #[inline(always)]
    fn test<const RAMPS: bool>(
        &self,
        expected: &Expected,
        start: usize,
        (corner, [right, below]): ([&[f32]; 2], [f32; 2]),
        taps: &TapSurfaces,
        shift: usize,
        trust: &mut [f32],
        failed: &mut [u32],
    ) {
        let len = trust.len();
        let failed = &mut failed[..len];
        let sure = &expected.trust[start..][..len];
        for i in 0..len {
            trust[i] = sure[i];
            failed[i] = bit(sure[i], rejection::VELOCITY);
        }
        if self.ids.is_some() {
            let (own, ids) = (&expected.id[start..][..len], &taps.ids[shift..][..len]);
            for i in 0..len {
                let this = same(own[i], ids[i]);
                count(&mut trust[i], &mut failed[i], this, rejection::ID);
            }
        }
        if self.direction.is_some() {
            let axes = taps.direction.axes.each_ref();
            let [vx, vy, vz] = axes.map(|axis| &axis[shift..][..len]);
            let lengths = &taps.direction.lengths[shift..][..len];
            let axes = expected.direction.each_ref();
            let [ex, ey, ez] = axes.map(|lane| &lane[start..][..len]);
            let own = &expected.length[start..][..len];
            for i in 0..len {
                let turn = -dot([ex[i], ey[i], ez[i]], [vx[i], vy[i], vz[i]]);
                let this = self.turn.trust_if::<RAMPS>(turn, own[i] * lengths[i]);
                count(&mut trust[i], &mut failed[i], this, rejection::NORMAL);
            }
        }
        if self.depth.is_some() {
            let own = &expected.depth[start..][..len];
            let depth = &taps.depth[shift..][..len];
            match (self.rays, self.normal) {
                (Some(rays), Some(_)) => {
                    let normal = match self.normal_is_direction {
                        true => &taps.direction,
                        false => &taps.normal,
                    };
                    let [vx, vy, vz] = normal.axes.each_ref().map(|axis| &axis[shift..][..len]);
                    let lengths = &normal.lengths[shift..][..len];
                    let point = expected.point.each_ref();
                    let [px, py, pz] = point.map(|lane| &lane[start..][..len]);
                    let [left, top] = corner.map(|lane| &lane[start..][..len]);
                    for i in 0..len {
                        let from = [px[i], py[i], pz[i]];
                        let (x, y) = (left[i] + right, top[i] + below);
                        let tap = rays.at(x + 0.5, y + 0.5) * depth[i];
                        let normal = [vx[i], vy[i], vz[i]];
                        let away = distance(from, tap.to_array(), normal);
                        let this = self.plane_trust::<RAMPS>(own[i], depth[i], away, lengths[i]);
                        count(&mut trust[i], &mut failed[i], this, rejection::DEPTH);
                    }
                }
                _ => {
                    for i in 0..len {
                        let this = self.depth_trust::<RAMPS>(own[i], depth[i]);
                        count(&mut trust[i], &mut failed[i], this, rejection::DEPTH);
                    }
                }
            }
        }
        if self.color.is_some() {
            let own = &expected.luminance[start..][..len];
            let luminance = &taps.luminance[shift..][..len];
            for i in 0..len {
                let this = self.luminance_trust::<RAMPS>(own[i], luminance[i]);
                count(&mut trust[i], &mut failed[i], this, rejection::LUMINANCE);
            }
        }
        if self.claims.is_some() {
            let [x, y] = expected.motion.each_ref().map(|lane| &lane[start..][..len]);
            let claims = taps.claims.each_ref();
            let [cx, cy, least] = claims.map(|lane| &lane[shift..][..len]);
            for i in 0..len {
                let this = self.motion_trust::<RAMPS>([x[i], y[i]], [cx[i], cy[i], least[i]]);
                count(&mut trust[i], &mut failed[i], this, rejection::MOTION);
            }
        }
    }

    /// The trust of pixel `i` of the run in the previous frame's pixel (x, y).
    #[inline(always)]
    pub(crate) fn trust(&self, expected: &Expected, i: usize, [x, y]: [f32; 2], at: usize) -> f32 {
        let mut trust = expected.trust[i];
        if let Some([_, before]) = self.ids {
            trust *= same(expected.id[i], before.at(at, 0));
        }
        if let Some([_, before]) = self.direction {
            let direction = before.vector(at);
            let turn = -dot(expected.direction.each_ref().map(|lane| lane[i]), direction);
            let lengths = expected.length[i] * length(direction);
            trust *= self.turn.trust(turn, lengths);
        }
        if let Some([_, before]) = self.depth {
            let (own, depth) = (expected.depth[i], placed(before.at(at, 0)));
            trust *= match (self.rays, self.normal) {
                (Some(rays), Some(before)) => {
                    let from = expected.point.each_ref().map(|lane| lane[i]);
                    let tap = rays.at(x + 0.5, y + 0.5) * depth;
                    let normal = before.vector(at);
                    let distance = distance(from, tap.to_array(), normal);
                    self.plane_trust::<true>(own, depth, distance, length(normal))
                }
                _ => self.depth_trust::<true>(own, depth),
            };
        }
        if let Some([_, before]) = self.color {
            let [r, g, b] = before.vector(at);
            trust *= self.luminance_trust::<true>(expected.luminance[i], luminance(r, g, b));
        }
        if let Some(claims) = self.claims {
            let own = expected.motion.each_ref().map(|lane| lane[i]);
            trust *= self.motion_trust::<true>(own, claims.vector(at));
        }
        trust
    }

    #[inline(always)]
    fn depth_trust<const RAMP: bool>(&self, expected: f32, depth: f32) -> f32 {
        let bound = self.params.relative_depth;
        let trust = bound.trust_if::<RAMP>((depth - expected).abs(), expected);
        surface_trust(expected, depth, trust)
    }

    /// `distance` is scaled by the length of the normal. A zero normal gives no plane: the depths are compared instead.
    #[inline(always)]
    fn plane_trust<const RAMP: bool>(
        &self,
        expected: f32,
        depth: f32,
        distance: f32,
        length: f32,
    ) -> f32 {
        let bound = self.params.plane_distance;
        let trust = bound.trust_if::<RAMP>(distance.abs(), expected * length);
        let trust = surface_trust(expected, depth, trust);
        let relative = self.depth_trust::<RAMP>(expected, depth);
        if length > 0.0 { trust } else { relative }
    }

    #[inline(always)]
    fn motion_trust<const RAMP: bool>(&self, own: [f32; 2], [x, y, least]: [f32; 3]) -> f32 {
        let bound = self.params.motion_difference;
        bound.trust_if::<RAMP>(math::distance(own, [x, y]) - least, 1.0)
    }

    #[inline(always)]
    fn luminance_trust<const RAMP: bool>(&self, l: f32, other: f32) -> f32 {
        let (larger, bound) = (l.abs().max(other.abs()), self.params.relative_luminance);
        let trust = bound.trust_if::<RAMP>((l - other).abs(), larger);
        let known = l.is_finite() & other.is_finite();
        if known { trust } else { 1.0 }
    }
}

/// Multiplies by the trust of one more test; sets its bit where that is 0.
#[inline(always)]
fn count(trust: &mut f32, failed: &mut u32, this: f32, rejection: u8) {
    *trust *= this;
    *failed |= bit(this, rejection);
}

#[inline(always)]
fn same(id: u32, other: u32) -> f32 {
    if id == other { 1.0 } else { 0.0 }
}

#[inline(always)]
fn bit(trust: f32, bit: u8) -> u32 {
    if trust > 0.0 { 0 } else { u32::from(bit) }
}

/// A depth; infinite for background.
#[inline(always)]
fn placed(depth: f32) -> f32 {
    if is_background(depth) {
        f32::INFINITY
    } else {
        depth
    }
}

/// The trust between two depths: background matches background alone, NaN and what is expected behind the camera nothing.
#[inline(always)]
fn surface_trust(expected: f32, depth: f32, trust: f32) -> f32 {
    let background = (expected == f32::INFINITY) | (depth == f32::INFINITY);
    let trust = if (expected > 0.0) & (depth > 0.0) {
        trust
    } else {
        0.0
    };
    let both = if expected == depth { 1.0 } else { 0.0 };
    if background { both } else { trust }
}

#[inline(always)]
fn length([x, y, z]: [f32; 3]) -> f32 {
    (x * x + y * y + z * z).sqrt()
}

#[inline(always)]
fn distance(a: [f32; 3], b: [f32; 3], along: [f32; 3]) -> f32 {
    dot([a[0] - b[0], a[1] - b[1], a[2] - b[2]], along)
}
