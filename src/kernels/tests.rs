//! Properties of the kernels: images of any size with any numbers, and parameters at the ends of their ranges.
//!
//! No kernel panics, also where overflow of integers is checked. Where colours are ordinary numbers, results are finite, and
//! means are within the range of the colours, whatever the other buffers hold: a constant stays itself.

use glam::{DMat4, DVec2, DVec3};
use proptest::prelude::*;

use super::camera::motion::{Geometry, Transforms, motion_vectors};
use super::camera::pinhole::{Camera, FovAxis};
use super::camera::{dilate, virtual_motion};
use super::fetch::footprint::Filter;
use super::fetch::validate::{self, Surface, Tests, Threshold};
use super::fetch::{claims, invert, pull_push, reproject, splat};
use super::judge::{
    alternation, anti_lag, blend_factor, choice, collocation, consistency, disocclusion, exposure,
    gradient, innovation, light_change, material_change, neighborhood, prediction, thin_features,
};
use super::merge::{accumulate, blend, combine, recirculate, resample, resolve};
use super::smooth::guide::{Guide, Sigmas};
use super::smooth::{
    atrous, demodulate, edges, fireflies, history_fix, joint_bilateral, lend, morphological,
    reflectance, regress, sharpen, variance,
};
use crate::image::{Image, Interleaved, Pixels, Size, plane_bands, segments};
use crate::pixels::{MotionLanes, PixelsMut};

#[test]
fn an_id_has_one_transform() {
    let twice = vec![
        (1, DMat4::IDENTITY),
        (2, DMat4::IDENTITY),
        (1, DMat4::IDENTITY),
    ];
    let error = Transforms::new(twice).err().expect("id 1 comes twice");
    assert!(
        error
            .to_string()
            .starts_with("transforms[1]: expected one matrix"),
        "{error}"
    );
}

/// An image each row of which stands for two, with both of them.
fn doubled(half: &Image, size: Size) -> Image {
    let mut doubled = Image::new(size, half.view().channels);
    for (channel, plane) in doubled.data_mut().chunks_mut(size.pixels()).enumerate() {
        for (y, row) in plane.chunks_mut(size.width).enumerate() {
            row.copy_from_slice(half.view().row(channel, y / 2));
        }
    }
    doubled
}

/// The bits of the second image, of so many channels, and of the coverage, everywhere.
fn fetched(fetch: &reproject::Fetch, channels: usize, motion: &Image) -> Vec<u32> {
    let Size { height, width } = motion.view().size;
    let (mut lanes, mut to, mut bits) = (MotionLanes::zeroed(), fetch.scratch(), vec![]);
    for run in (0..height).flat_map(|y| segments(y, width)) {
        fetch.run(run, lanes.load(&motion.pixels(), run), &mut to);
        let values = to.values(1)[..run.len * channels].iter();
        let coverage = to.coverage[..run.len].iter();
        bits.extend(values.chain(coverage).map(|value| value.to_bits()));
    }
    bits
}

/// A fraction of the usual number of cases: images have many pixels, and tests are not optimised.
fn few() -> ProptestConfig {
    let usual = ProptestConfig::default();
    ProptestConfig {
        cases: usual.cases.div_ceil(8),
        ..usual
    }
}

/// Numbers that arithmetic treats differently, all bits beside them.
const SPECIAL: [f32; 13] = [
    f32::NAN,
    f32::INFINITY,
    f32::NEG_INFINITY,
    f32::MAX,
    f32::MIN,
    f32::MIN_POSITIVE,
    1e-45,
    -1e-45,
    1e20,
    1e-20,
    0.0,
    -0.0,
    -1.0,
];

/// Parameters that have no upper bound.
const FROM_0: [f32; 5] = [0.0, 1e-30, 1.0, 100.0, f32::MAX];
const ABOVE_0: [f32; 5] = [f32::MIN_POSITIVE, 1e-3, 1.0, 100.0, f32::MAX];
const SHARES: [f32; 4] = [0.0, 1e-6, 0.3, 1.0];

/// Exposures of images of 0 to 8; a tone curve rounds colours away that are far brighter.
const EXPOSURES: [f32; 3] = [0.1, 1.0, 1e3];

/// Draws images and parameters; a function of its seed.
#[derive(Clone, Copy, Debug)]
struct Draw {
    size: Size,
    seed: u64,
}

/// Any size around a band's height, a vector's and a segment's width, and any seed.
fn draw() -> impl Strategy<Value = Draw> {
    let height = prop_oneof![1_usize..9, 15_usize..19];
    let width = prop_oneof![1_usize..36, 158_usize..164];
    (height, width, any::<u64>()).prop_map(|(height, width, seed)| Draw {
        size: Size { height, width },
        seed,
    })
}

impl Draw {
    /// SplitMix64.
    fn next(&mut self) -> u64 {
        self.seed = self.seed.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (self.seed ^ (self.seed >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    fn of<T: Copy>(&mut self, choices: &[T]) -> T {
        choices[self.next() as usize % choices.len()]
    }

    fn coin(&mut self) -> bool {
        self.of(&[false, true])
    }

    /// 0 to 1.
    fn share(&mut self) -> f32 {
        (self.next() >> 40) as f32 / (1 << 24) as f32
    }

    fn image_of(
        &mut self,
        size: Size,
        channels: usize,
        number: impl Fn(&mut Self) -> f32,
    ) -> Image {
        let mut image = Image::new(size, channels);
        image.data_mut().fill_with(|| number(self));
        image
    }

    /// Ordinary colours, or lengths, or shares of `scale`.
    fn tame(&mut self, channels: usize, scale: f32) -> Image {
        self.image_of(self.size, channels, |draw| scale * draw.share())
    }

    /// Any numbers.
    fn wild_of(&mut self, size: Size, channels: usize) -> Image {
        self.image_of(size, channels, |draw| match draw.next() % 8 {
            0 => draw.of(&SPECIAL),
            1 => f32::from_bits(draw.next() as u32),
            2 => 100.0 * (draw.share() - 0.5),
            _ => 8.0 * draw.share(),
        })
    }

    fn wild(&mut self, channels: usize) -> Image {
        self.wild_of(self.size, channels)
    }

    /// Colours of which some are missing.
    fn holes(&mut self) -> Image {
        let share = self.of(&[0.0, 0.1, 0.75, 1.0]);
        self.image_of(self.size, 3, |draw| match draw.share() < share {
            true => draw.of(&[f32::NAN, f32::INFINITY]),
            false => 8.0 * draw.share(),
        })
    }

    /// Numbers of samples, some unknown.
    fn lengths(&mut self) -> Image {
        self.image_of(self.size, 1, |draw| match draw.next() % 16 {
            0 => draw.of(&[0.0, f32::NAN, f32::INFINITY]),
            _ => 64.0 * draw.share(),
        })
    }

    fn ids(&mut self) -> Image<u32> {
        let mut image = Image::new(self.size, 1);
        image
            .data_mut()
            .fill_with(|| self.of(&[0, 1, 2, u32::MAX - 1, u32::MAX]));
        image
    }

    /// The buffers of a frame, each of them there or not.
    fn buffers(&mut self) -> Buffers {
        let mut maybe = |channels| self.coin().then(|| self.wild(channels));
        let (depth, normal, object_normal, color) = (maybe(1), maybe(3), maybe(3), maybe(3));
        let ids = self.coin().then(|| self.ids());
        Buffers {
            depth,
            normal,
            object_normal,
            color,
            ids,
        }
    }

    fn camera(&mut self) -> Camera {
        let Size { height, width } = self.size;
        let at = |draw: &mut Self| DVec3::from_array([(); 3].map(|()| draw.share().into()));
        let centre = DVec2::new(width as f64 * 0.4, height as f64 * 0.6);
        let origin = 5.0 * DVec3::Z + at(self);
        Camera::from_look_at(
            origin,
            at(self),
            DVec3::Y,
            self.of(&[1.0, 50.0, 170.0]),
            self.size,
            FovAxis::X,
            Some(centre),
        )
        .expect("a projection")
    }

    fn sigmas(&mut self) -> Sigmas {
        Sigmas {
            normal: self.of(&FROM_0),
            depth: self.of(&ABOVE_0),
            plane: self.of(&ABOVE_0),
        }
    }

    /// A guide by any buffers, for taps up to `reach` pixels away.
    fn guide(&mut self, reach: usize) -> Guide {
        Guide::new(self.size, reach, self.buffers().surface(), None)
    }

    /// Bounds of a test, a ramp or not.
    fn bounds(&mut self, ends: &[f32]) -> Threshold {
        let (one, other) = (self.of(ends), self.of(ends));
        Threshold {
            full: one.min(other),
            none: one.max(other),
        }
    }
}

struct Buffers {
    depth: Option<Image>,
    normal: Option<Image>,
    object_normal: Option<Image>,
    color: Option<Image>,
    ids: Option<Image<u32>>,
}

impl Buffers {
    fn surface(&self) -> Surface<'_> {
        Surface {
            depth: self.depth.as_ref().map(Image::pixels),
            normal: self.normal.as_ref().map(Image::pixels),
            ids: self.ids.as_ref().map(Image::pixels),
            object_normal: self.object_normal.as_ref().map(Image::pixels),
            color: self.color.as_ref().map(Image::pixels),
        }
    }
}

/// What a kernel writes into an interleaved image of some channels.
macro_rules! written {
    ($size:expr, $channels:expr, |$bands:ident| $call:expr) => {{
        let mut data = vec![f32::NAN; $size.pixels() * $channels];
        {
            let $bands = PixelsMut::bands($size, $channels, &mut data);
            $call;
        }
        data
    }};
}

/// That all numbers are in the range of some images' finite ones, but for rounding, or not finite if pixels may be missing.
fn in_range_of(got: &[f32], images: &[&Image], missing: bool) -> Result<(), TestCaseError> {
    let known = images.iter().flat_map(|image| image.pixels().elements().0);
    let known = known.copied().filter(|v| v.is_finite());
    let (low, high) = known.fold((f32::INFINITY, f32::NEG_INFINITY), |(low, high), v| {
        (low.min(v), high.max(v))
    });
    let slack = 1e-4 * high.abs().max(low.abs());
    for &v in got {
        let inside = (low - slack..=high + slack).contains(&v);
        prop_assert!(
            inside || missing && !v.is_finite(),
            "{v} of {low} to {high}"
        );
    }
    Ok(())
}

fn shares(got: &[f32]) -> Result<(), TestCaseError> {
    for &v in got {
        prop_assert!((0.0..=1.0).contains(&v), "{v} is no share");
    }
    Ok(())
}

fn finite(got: &[f32]) -> Result<(), TestCaseError> {
    for &v in got {
        prop_assert!(v.is_finite(), "{v} is not finite");
    }
    Ok(())
}

proptest! {
    #![proptest_config(few())]

    #[test]
    fn camera(mut draw in draw()) {
        let size = draw.size;
        let (now, before) = (draw.camera(), draw.camera());
        let (depth, position, ids) = (draw.wild(1), draw.wild(3), draw.ids());
        let geometry = match draw.coin() {
            true => Geometry::Depth(depth.pixels()),
            false => Geometry::Position(position.pixels()),
        };
        let matrix = DMat4::from_scale(DVec3::new(1e-9, 1e9, 0.0));
        let moved = Transforms::new(vec![(1, matrix), (u32::MAX, DMat4::IDENTITY)]).expect("affine");
        written!(size, 3, |motion| motion_vectors(geometry, &now, &before, Some(ids.pixels()), &moved, motion));
        let distance = draw.wild(1);
        written!(size, 2, |motion| virtual_motion::virtual_motion(geometry, distance.pixels(), &now, &before, motion));
        let motion = draw.wild(3);
        let params = dilate::Params { window: draw.of(&dilate::Window::NAMES).1, margin: 0.9 * draw.share() };
        let choice = match draw.coin() {
            true => {
                let still = draw.coin().then(|| position.pixels());
                dilate::Choice::Nearest { depth: depth.view(), still }
            }
            false => dilate::Choice::Longest,
        };
        let dilated = written!(size, 3, |dilated| dilate::dilate_motion(motion.pixels(), choice, params, dilated));
        let known = |v: &f32| motion.pixels().elements().0.iter().any(|m| m.to_bits() == v.to_bits());
        prop_assert!(dilated.iter().all(|v| v.is_nan() || known(v)));
    }

    #[test]
    fn fetch(mut draw in draw()) {
        let (size, n) = (draw.size, draw.size.pixels());
        let (motion, history, rays) = (draw.wild(3), draw.holes(), draw.camera().rays());
        let (now, before) = (draw.buffers(), draw.buffers());
        let params = validate::Params {
            relative_depth: draw.bounds(&[1e-6, 0.1, 10.0]),
            plane_distance: draw.bounds(&[1e-6, 0.01, 1.0]),
            normal_angle: draw.bounds(&[0.0, 25.0, 180.0]),
            relative_luminance: draw.bounds(&[0.0, 0.5, 2.0]),
            speed: draw.coin().then(|| draw.bounds(&[0.0, 1.0, 1e6])),
            motion_difference: draw.bounds(&[0.0, 0.5, 1e6]),
        };
        let claims = draw.coin().then(|| claims::claims(motion.pixels(), draw.wild(2).pixels()));
        let claims = claims.as_ref().map(Interleaved::pixels);
        let tests = || Tests::new(now.surface(), before.surface(), Some(rays), &params).with_claims(claims);
        let way = reproject::Params { filter: draw.of(&Filter::NAMES).1, fallback: draw.coin(), dering: true };
        let records = Interleaved::of(history.view());
        let mut values = vec![f32::NAN; 3 * n];
        let mut coverage = vec![f32::NAN; n];
        reproject::reproject_interleaved(&[records.pixels()], motion.pixels(), tests(), way, vec![&mut values], &mut coverage);
        let covered = values.chunks(3).zip(&coverage).filter(|(_, share)| **share > 0.0);
        let covered: Vec<_> = covered.flat_map(|(pixel, _)| pixel).copied().collect();
        in_range_of(&covered, &[&history], false)?;
        shares(&coverage)?;

        let channels = draw.of(&[1, 3, 6, 8, 10]);
        let half = draw.wild_of(Size { height: size.height.div_ceil(2), ..size }, channels);
        let (half, doubled) = (Interleaved::of(half.view()), Interleaved::of(doubled(&half, size).view()));
        let [halved, whole] = [
            reproject::Fetch::new(&[records.pixels()], size, tests(), way).and_halved(half.pixels()),
            reproject::Fetch::new(&[records.pixels(), doubled.pixels()], size, tests(), way),
        ]
        .map(|fetch| fetched(&fetch, channels, &motion));
        prop_assert_eq!(halved, whole);

        let mut mask = vec![0; n];
        let judged = plane_bands(&mut mask, size).zip(plane_bands(&mut coverage, size));
        consistency::consistency(motion.pixels(), tests(), judged);
        shares(&coverage)?;

        let depth = draw.wild(1);
        written!(size, 3, |inverse| invert::invert_motion(motion.pixels(), Some(depth.pixels()), None, inverse));

        let (offset, quality) = (draw.wild(2), draw.lengths());
        let points = splat::Points {
            color: history.pixels(),
            depth: depth.pixels(),
            offset: Some(offset.pixels()),
            drift: Some(motion.pixels()),
            quality: Some(quality.pixels()),
        };
        let params = splat::Params { tolerance: draw.of(&ABOVE_0), reach: draw.of(&SHARES) };
        let (mut color, mut depths, mut offsets, mut qualities) =
            (vec![0.0; 3 * n], vec![0.0; n], vec![0.0; 2 * n], vec![0.0; n]);
        let splats = splat::Splats {
            color: &mut color,
            depth: &mut depths,
            offset: &mut offsets,
            quality: &mut qualities,
        };
        splat::splat(points, [&draw.camera(), &draw.camera()], params, splats);
        in_range_of(&color, &[&history], true)?;

        let quality = draw.tame(1, 8.0);
        let params = pull_push::Params { factor: draw.of(&[2, 3, 16]), levels: draw.of(&[1, 2, usize::MAX]) };
        pull_push::pull_push(history.pixels(), Some(quality.pixels()), params, &mut color, &mut qualities);
        in_range_of(&color, &[&history], true)?;
    }

    #[test]
    fn judge(mut draw in draw()) {
        let size = draw.size;
        let (color, history) = (draw.wild(3), draw.wild(3));
        let (tame, older) = (draw.tame(3, 8.0), draw.tame(3, 8.0));
        let (motion, depth, coverage) = (draw.wild(3), draw.wild(1), draw.tame(1, 1.0));
        let (length, light) = (draw.tame(1, 64.0), draw.of(&ABOVE_0));

        let similarity = draw.of(&[1.0, 1.5, f32::MAX]);
        shares(&written!(size, 1, |thin| thin_features::thin_features(color.pixels(), similarity, thin)))?;
        let share = draw.of(&SHARES);
        shares(&written!(size, 1, |hidden| disocclusion::disocclusion(depth.view(), motion.pixels(), share, hidden)))?;

        let params = material_change::Params {
            relative_luminance: draw.of(&FROM_0), share: draw.of(&SHARES), radius: draw.of(&[0, 1, 16]),
        };
        if let Some(changed) = material_change::material_change(depth.view(), length.view(), motion.pixels(), params) {
            shares(changed.plane(0))?;
        }

        let memory = draw.wild(alternation::CHANNELS);
        let known = alternation::Known { memory: memory.pixels(), coverage: Some(coverage.view()) };
        written!(size, alternation::CHANNELS, |next| alternation::alternation(color.pixels(), Some(known), light, next));
        let exposure = draw.of(&EXPOSURES);
        finite(&written!(size, alternation::CHANNELS, |next| alternation::alternation(tame.pixels(), None, exposure, next)))?;

        let params = gradient::Params { noise: draw.of(&FROM_0), passes: draw.of(&[1, 3]), widest: draw.of(&[3, 8]) };
        let mut change = vec![f32::NAN; size.pixels()];
        gradient::temporal_gradient(color.pixels(), history.pixels(), None, params, &mut change);
        shares(&change)?;

        let params = blend_factor::Params {
            alpha: draw.of(&SHARES),
            fast_alpha: draw.of(&SHARES),
            speed: draw.bounds(&[0.0, 1.0, 1e9]),
        };
        let alpha = written!(size, 1, |alpha| blend_factor::blend_factor(coverage.view(), Some(motion.pixels()), params, alpha));
        shares(&alpha)?;

        let strength = draw.of(&FROM_0);
        let shortened = written!(size, 1, |short| anti_lag::anti_lag(length.view(), history.pixels(), color.pixels(), strength, short));
        for (new, old) in shortened.iter().zip(length.plane(0)) {
            prop_assert!((0.0..=old * 1.000_001).contains(new), "{new} of {old}");
        }

        prop_assert!(exposure::exposure(color.pixels()) > 0.0);
        let change = light_change::light_change(color.pixels(), tame.pixels(), None);
        prop_assert!(change > 0.0 && change.is_finite());

        let clip = neighborhood::Params {
            bounds: draw.of(&neighborhood::Params::BOUNDS).1,
            gamma: draw.of(&FROM_0),
            radius: draw.of(&[1, 2]),
            space: draw.of(&neighborhood::Params::SPACES).1,
            response: draw.of(&neighborhood::Params::RESPONSES).1,
            exposure: light,
        };
        if clip.check().is_ok() {
            written!(size, 3, |clipped| neighborhood::clip_history(history.pixels(), color.pixels(), clip, clipped));
            let clip = neighborhood::Params { exposure: draw.of(&EXPOSURES), ..clip };
            finite(&written!(size, 3, |clipped| neighborhood::clip_history(older.pixels(), tame.pixels(), clip, clipped)))?;
        }

        let ids = draw.ids();
        let mut gain = vec![f32::NAN; size.pixels()];
        for [k, h, c] in [[&history, &color, &color], [&older, &tame, &tame]] {
            let bands = plane_bands(&mut gain, size);
            prediction::prediction_gain(k.pixels(), h.pixels(), c.pixels(), Some(ids.pixels()), draw.of(&[1, 3]), draw.of(&[false, true]), bands);
        }
        finite(&gain)?;
    }

    #[test]
    fn corrections_and_choices(mut draw in draw()) {
        let size = draw.size;
        let motion = draw.wild(3);
        let light = draw.of(&[1e-6, 1.0, 1e6]);
        let params = innovation::Params {
            strictness: draw.of(&FROM_0),
            share: draw.of(&[1e-6, 0.5, 1.0]),
            levels: draw.of(&[1, 4, 8]),
            fed_back: draw.coin(),
            sparse: draw.coin(),
        };
        let small = innovation::evidence_size(size);
        let (length, evidence) = (draw.wild(1), draw.wild_of(small, innovation::CHANNELS));
        let evidence = Interleaved::of(evidence.view());
        fn over<'a>(colors: &'a Pixels<'a>, lengths: &'a Image) -> innovation::Predicted<'a, Pixels<'a>> {
            innovation::Predicted { colors, lengths: lengths.pixels() }
        }
        for (color, prediction) in [(draw.wild(3), draw.wild(3)), (draw.tame(3, 8.0), draw.tame(3, 8.0))] {
            let (fresh, p) = (color.pixels(), prediction.pixels());
            let known = innovation::Known { evidence: evidence.pixels(), motion: Some(motion.pixels()) };
            innovation::innovation(&fresh, None, &over(&p, &length), Some(known), light, params);
            let lengths = draw.tame(1, 64.0);
            let (found, rest) = innovation::innovation(&fresh, None, &over(&p, &lengths), None, light, params);
            let added = written!(size, 3, |added| found.corrections(&p, size, added));
            if color.plane(0).iter().all(|v| v.is_finite() && *v <= 8.0) && draw.coin() {
                let known = innovation::Known { evidence: rest.pixels(), motion: None };
                innovation::innovation(&fresh, None, &over(&p, &lengths), Some(known), light, params);
            }
            let tame = [&color, &prediction].iter().all(|image| image.pixels().elements().0.iter().all(|v| (0.0..=8.0).contains(v)));
            if tame {
                finite(&added)?;
            }
        }

        let count = draw.of(&[2, 3, 5]);
        let usual = draw.next() as usize % count;
        let tiles = choice::tiles(size);
        let sums = draw.wild_of(tiles, choice::channels(count));
        let mut sums = Interleaved::of(sums.view());
        let (color, candidates, coverage) = (draw.wild(3), draw.wild(count), draw.wild(1));
        let views: Vec<_> = (0..count).map(|k| candidates.view().channel(k)).collect();
        choice::compare(&color.pixels(), &views, light, usual, &mut sums);
        let params = choice::Params { strictness: draw.of(&FROM_0), frame_strictness: draw.of(&FROM_0), share: draw.of(&SHARES) };
        let (chosen, _) = choice::choice(sums.pixels(), motion.pixels(), coverage.view(), usual, params);
        prop_assert!(chosen.plane(0).iter().all(|&k| (0.0..count as f32).contains(&k)));

        let products = draw.wild_of(tiles, collocation::CHANNELS);
        let mut products = Interleaved::of(products.view());
        let planes = draw.wild(collocation::PLANES);
        collocation::collocate(&planes.pixels(), light, &mut products);
        let (shares, _) = collocation::shares(products.pixels(), motion.pixels(), coverage.view(), draw.of(&SHARES));
        prop_assert!(shares.pixels().elements().0.iter().all(|share| (0.0..=1.0).contains(share)));
    }

    #[test]
    fn merge(mut draw in draw()) {
        let size = draw.size;
        let (color, history, other) = (draw.holes(), draw.holes(), draw.holes());
        let share = draw.tame(1, 1.0);

        let params = blend::Params {
            weighting: draw.of(&blend::Params::WEIGHTINGS).1,
            flicker: draw.of(&SHARES),
            exposure: draw.of(&[1e-6, 1.0, 1e6]),
        };
        let alpha = match draw.coin() {
            true => blend::Alpha::Constant(draw.of(&SHARES)),
            false => blend::Alpha::Map(share.view()),
        };
        let blended = written!(size, 3, |blended| blend::blend(color.pixels(), history.pixels(), alpha, params, blended));
        in_range_of(&blended, &[&color, &history], true)?;

        let (moments, length) = (draw.wild(2), draw.lengths());
        let (newer, longer) = (draw.wild(2), draw.lengths());
        let params = accumulate::Params { alpha: draw.of(&SHARES), moments_alpha: draw.of(&SHARES), warmup: true };
        let samples = accumulate::Samples {
            size,
            color: &color.pixels(),
            weight: Some(share.view()),
            gradient: Some(share.view()),
        };
        let images = accumulate::Images {
            parts: [history.pixels(), moments.pixels(), length.pixels()],
            confidence: Some(share.view()),
        };
        let merged = written!(size, 6, |bands| {
            accumulate::accumulate(samples, &images, params, bands.map(|band| [(0..6, band)]), std::iter::repeat(()))
        });
        let colors: Vec<_> = merged.chunks(6).flat_map(|pixel| &pixel[..3]).copied().collect();
        in_range_of(&colors, &[&color, &history], true)?;
        let first = [history.pixels(), moments.pixels(), length.pixels()];
        let second = [other.pixels(), newer.pixels(), longer.pixels()];
        let combined = written!(size, 6, |bands| {
            combine::combine(first, second, Some(share.view()), Some(1.0), bands.map(|band| [(0..6, band)]))
        });
        let colors: Vec<_> = combined.chunks(6).flat_map(|pixel| &pixel[..3]).copied().collect();
        in_range_of(&colors, &[&history, &other], true)?;

        let (quality, motion) = (draw.tame(1, 8.0), draw.wild(3));
        let params = recirculate::Params {
            blur: draw.of(&SHARES),
            share: draw.of(&[[0.0, 1.0], [0.0, 0.0], [0.2, 0.3], [1.0, 1.0]]),
            fade: draw.of(&[1e-6, 1.0, f32::INFINITY]),
            limit: draw.of(&ABOVE_0),
            fetch: draw.coin(),
        };
        let filled = recirculate::Known { color: color.pixels(), quality: quality.pixels() };
        let older = recirculate::Known { color: history.pixels(), quality: share.pixels() };
        let mut qualities = vec![f32::NAN; size.pixels()];
        let blended = written!(size, 3, |blended| {
            let qualities = PixelsMut::bands(size, 1, &mut qualities);
            recirculate::recirculate(filled, older, motion.pixels(), params, blended, qualities);
        });
        in_range_of(&blended, &[&color, &history], true)?;

        let larger = Size { height: draw.of(&[1, 9, 33]), width: draw.of(&[1, 31, 165]) };
        let offset = [draw.of(&[-1e9, -0.5, 0.0, 0.3]), draw.of(&[-0.5, 0.0, 7.0, 1e300])];
        let filter = draw.of(&resample::FILTERS).1;
        let mut weights = vec![f32::NAN; larger.pixels()];
        let resampled = written!(larger, 3, |resampled| {
            let weights = PixelsMut::bands(larger, 1, &mut weights);
            resample::resample(color.pixels(), larger, offset, filter, true, resampled, weights);
        });
        in_range_of(&resampled, &[&color], true)?;
        finite(&weights)?;

        let filter = draw.of(&resolve::Filter::NAMES).1;
        let frames = [(color.pixels(), [0.5, -0.5]), (history.pixels(), [0.0, 0.25])];
        let resolved = written!(size, 3, |resolved| resolve::resolve(&frames, filter, resolved));
        if !matches!(filter, resolve::Filter::Mitchell) {
            in_range_of(&resolved, &[&color, &history], true)?;
        }
    }

    #[test]
    fn smooth(mut draw in draw()) {
        draw.size.width = draw.size.width.min(40); // windows are large
        let (size, n) = (draw.size, draw.size.pixels());
        let (color, length, noise) = (draw.holes(), draw.lengths(), draw.wild(1));
        let mut into = vec![f32::NAN; n];

        let params = atrous::Params {
            iterations: draw.of(&[0, 1, 3, 16]),
            radius: draw.of(&[1, 2]),
            sigma_luminance: draw.of(&ABOVE_0),
            relative_noise: draw.of(&ABOVE_0),
            settled: draw.of(&[0.0, 2.0]),
            sigmas: draw.sigmas(),
        };
        let limited = draw.coin();
        let predicted = draw.coin().then(|| draw.wild(1));
        let source = atrous::Source {
            color: color.pixels(),
            variance: noise.pixels(),
            prediction: predicted.as_ref().map(Image::pixels),
            samples: limited.then(|| length.pixels()),
            exposure: draw.of(&ABOVE_0),
        };
        let guide = draw.guide(params.reach());
        let mut prediction = predicted.as_ref().map(|_| vec![f32::NAN; n]);
        let filtered = written!(size, 3, |filtered| {
            atrous::atrous(source, &guide, params, filtered, &mut into, prediction.as_deref_mut());
        });
        in_range_of(&filtered, &[&color], true)?;

        let params = variance::Params { min_length: draw.of(&[1.0, 3.5, f32::MAX]), radius: draw.of(&[0, 3, 7]), sigmas: draw.sigmas() };
        let (moments, guide) = (draw.wild(2), draw.guide(params.radius));
        let estimate = variance::Estimate::new(moments.pixels(), length.pixels(), &guide, params);
        variance::estimate_variance(&estimate, &mut into);
        prop_assert!(into.iter().all(|v| *v >= 0.0));

        let window = joint_bilateral::Params { radius: draw.of(&[1, 2, 7]), sigma: draw.of(&ABOVE_0), sigmas: draw.sigmas() };
        let guide = draw.guide(window.radius);
        let filled = joint_bilateral::reconstruct(color.pixels(), &guide, window);
        in_range_of(filled.pixels().elements().0, &[&color], true)?;
        let lent = lend::lend(&color, length.view(), &guide, lend::Params { weight: draw.of(&[1e-6, 0.1, 1.0]), window });
        in_range_of(lent.color.pixels().elements().0, &[&color], true)?;

        let scale = draw.of(&[1, 2, 16]);
        let grid = joint_bilateral::Grid { full: size, scale, offset: [draw.share(), draw.share()].map(|s| s * (scale - 1) as f32) };
        let low = draw.image_of(grid.low(), 3, Draw::share);
        let window = joint_bilateral::Params { radius: draw.of(&[1, 2]), ..window };
        let guide = draw.guide(window.radius * scale);
        let upsampled = joint_bilateral::joint_bilateral_upsample(low.pixels(), grid, [&guide, &guide], window);
        in_range_of(upsampled.pixels().elements().0, &[&low], true)?;

        let params = history_fix::Params { max_length: draw.of(&FROM_0), stride: draw.of(&[1.0, 14.0, 64.0]), sigmas: draw.sigmas() };
        let guide = draw.guide(params.reach());
        history_fix::fix_history(color.view(), noise.view(), &guide, params);
        let fixed = history_fix::fix_history(color.view(), length.view(), &guide, params);
        in_range_of(fixed.pixels().elements().0, &[&color], true)?;

        let params = fireflies::Params { threshold: draw.of(&FROM_0), radius: draw.of(&[1, 4, 7]), redistribute: false, sigmas: draw.sigmas() };
        let (expected, guide) = (draw.wild(3), draw.guide(params.radius));
        for redistribute in [true, false] {
            let params = fireflies::Params { redistribute, ..params };
            written!(size, 3, |held| fireflies::suppress_fireflies(color.pixels(), Some(expected.pixels()), &guide, params, held));
        }
    }

    #[test]
    fn smooth_without_a_guide(mut draw in draw()) {
        let (size, n) = (draw.size, draw.size.pixels());
        let (color, wild) = (draw.holes(), draw.wild(3));

        let params = sharpen::Params { strength: draw.of(&SHARES), exposure: draw.of(&EXPOSURES) };
        in_range_of(&written!(size, 3, |sharp| sharpen::sharpen(color.pixels(), params, sharp)), &[&color], true)?;
        let params = sharpen::Params { exposure: draw.of(&ABOVE_0), ..params };
        written!(size, 3, |sharp| sharpen::sharpen(wild.pixels(), params, sharp));

        let mut smoothed = color.clone();
        edges::smooth_edges(color.pixels(), None, None, draw.of(&EXPOSURES), smoothed.pixels_mut());
        in_range_of(smoothed.pixels().elements().0, &[&color], true)?;
        let (mut smoothed, newest) = (color.clone(), draw.holes());
        let (newest, known) = (Some(newest.pixels()), Some(draw.wild(1)));
        let known = known.as_ref().map(|image| image.view());
        edges::smooth_edges(color.pixels(), newest, known, draw.of(&EXPOSURES), smoothed.pixels_mut());
        in_range_of(smoothed.pixels().elements().0, &[&color], true)?;
        let newest = draw.of(&[None, Some(wild.pixels())]);
        edges::smooth_edges(wild.pixels(), newest, known, draw.of(&ABOVE_0), wild.clone().pixels_mut());

        let params = morphological::Params { threshold: 0.1, max_length: draw.of(&[1, 32]) };
        let smoothed = morphological::morphological_aa(color.view(), params);
        in_range_of(smoothed.pixels().elements().0, &[&color], true)?;
        morphological::morphological_aa(wild.view(), params);

        let (normal, position, depth, weight) = (draw.wild(3), draw.wild(3), draw.wild(1), draw.wild(1));
        let ids = draw.ids();
        let features = regress::Features {
            normal: draw.coin().then(|| normal.pixels()),
            place: match draw.of(&[0, 1, 2]) {
                0 => None,
                1 => Some(regress::Place::Position(position.pixels())),
                _ => Some(regress::Place::Depth(depth.pixels(), draw.camera().rays())),
            },
        };
        let params = regress::Params {
            block: draw.of(&[4, 32, 256]),
            offset: [draw.of(&[0, -5, i64::MAX]), draw.of(&[0, 3, i64::MIN])],
            features: draw.of(&regress::Params::FEATURES).1,
        };
        let (mut fitted, mut used) = (vec![f32::NAN; 3 * n], vec![0; n]);
        regress::regress(color.pixels(), features, Some(weight.pixels()), params, &mut fitted, &mut used);
        in_range_of(&fitted, &[&color], true)?;

        let surfaces = reflectance::Surfaces::new(position.pixels(), ids.pixels());
        let mask = draw.coin().then(|| surfaces.mask());
        let texture = demodulate::Texture { albedo: position.pixels(), emission: Some(normal.pixels()), mask };
        for way in [demodulate::Way::Off, demodulate::Way::Back] {
            written!(size, 3, |out| demodulate::modulate(wild.pixels(), texture, way, out));
        }
        let (tame, albedo) = (draw.tame(3, 8.0), draw.wild(3));
        let texture = demodulate::Texture { albedo: albedo.pixels(), emission: None, mask: None };
        finite(&written!(size, 3, |out| demodulate::modulate(tame.pixels(), texture, demodulate::Way::Off, out)))?;
    }
}
