//! The kernels of the judge folder that compare predictions with samples that these have not seen, and what is carried of that
//! from frame to frame.

use numpy::PyArrayDyn;
use pyo3::prelude::*;

use super::arrays::{COLOR, Channels, Input, MOTION, Out, fill_parts};
use crate::error::{Error, from_0_to_1, whole};
use crate::image::{Interleaved, plane_bands};
use crate::kernels::judge::{choice, collocation, exposure, prediction, repetition};

/// Choose the best of several predictions, tile by tile, by the evidence of earlier frames.
///
/// Parameters
/// ----------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) array_like of float
///     The previous frame's, as `compare_candidates` returns it.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Motion in pixels. A tile's evidence comes from where its centre does.
/// coverage : (H, W) array_like of float
///     Above 0 where the pixel's surface was visible in the previous frame (see `reproject`); tiles whose centre was
///     not have no evidence.
/// usual : int, default 0
///     The default candidate, unless another is better for the frame as a whole. The default is chosen without
///     evidence, and all others are compared with it.
/// strictness : float, default 0.5
///     Standard errors by which another candidate must be better than the default; at least 0.
/// frame_strictness : float, default 3
///     Standard errors by which another candidate must be better than `usual` for the frame as a whole to become the
///     default; at least 0, infinite to keep `usual`.
/// share : float, default 0.3
///     Fraction of the evidence that decays per frame; 0 to 1.
/// out : tuple of (⌈H/8⌉, ⌈W/8⌉) and (⌈H/8⌉, ⌈W/8⌉, 2 K) float32 arrays, optional
///     Written and returned, as choice and evidence, instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// choice : (⌈H/8⌉, ⌈W/8⌉) float32
///     The candidate that each tile of 8×8 pixels should show: an integer from 0 to K - 1. To hide the tiles,
///     interpolate between their centres, and mix two candidates where the result is fractional.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32
///     The evidence where the tiles are in this frame, decayed: `compare_candidates` adds this frame's.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, evidence of fewer than 2 candidates, or parameters out of range.
///
/// See Also
/// --------
/// compare_candidates : Adds a frame's evidence.
/// SVGF : Chooses the number of filter passes in this way.
///
/// Notes
/// -----
/// A tile's sums are averaged with those of its neighbours, with weights {1, 2, 1}/4 along each axis. The candidate
/// with the least mean gain plus `strictness` standard errors of the steps between it and the default one wins if that
/// is below 0; with fewer than 16 samples in the average, the default candidate stays. The variance of an average is
/// that of a tile, divided by 64/9, the effective number of tiles in it. What is best for the frame is the best
/// guess for a tile that knows nothing: the mean gains of all pixels in tiles of at least 16 samples decide first, in
/// the same way.
///
/// Examples
/// --------
/// >>> sample = np.ones((8, 8, 3))
/// >>> candidates = np.stack([np.full((8, 8), 0.5), np.full((8, 8), 1.0)], -1)
/// >>> evidence = yester.compare_candidates(sample, candidates)
/// >>> best, evidence = yester.choice(evidence, np.zeros((8, 8, 2)), np.ones((8, 8)))
/// >>> best
/// array([[1.]], dtype=float32)
#[pyfunction]
#[pyo3(
    name = "choice",
    signature = (
        evidence, motion, coverage, *, usual=0, strictness=0.5, frame_strictness=3.0, share=0.3, out=None
    )
)]
pub fn choice_<'py>(
    py: Python<'py>,
    evidence: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    coverage: &Bound<'py, PyAny>,
    usual: i128,
    strictness: f32,
    frame_strictness: f32,
    share: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f32>>)> {
    let params = choice::Params {
        strictness,
        frame_strictness,
        share,
    };
    params.check()?;
    let [chosen, carried] = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let size = motion.size();
        let coverage = Input::<f32>::of_size(coverage, "coverage", Channels::One, size)?;
        let tiles = choice::tiles(size);
        let evidence = Input::<f32>::of_size(evidence, "evidence", Channels::Any, tiles)?;
        let numbers = evidence.pixels().channels;
        if numbers < 4 || !numbers.is_multiple_of(2) {
            let got = format!("{numbers} channels");
            return Err(Error::value("evidence", "4, 6, 8, … channels", got).into());
        }
        let last = numbers / 2 - 1;
        let expected = format!("a candidate, 0 to {last}");
        let usual = whole("usual", usual, &expected, |&n: &usize| n <= last)?;
        let shape = [tiles.height, tiles.width, numbers];
        let shapes = [&shape[..2], &shape];
        let [evidence, motion, coverage] = [&evidence, &motion, &coverage].map(Input::pixels);
        fill_parts(py, out.as_ref(), shapes, |[chosen, carried]| {
            let coverage = coverage.plane();
            let (best, rest) = choice::choice(evidence, motion, coverage, usual, params);
            chosen.copy_from_slice(best.plane(0));
            carried.copy_from_slice(rest.pixels().elements().0);
        })?
    };
    Ok((chosen.array()?, carried.array()?))
}

/// Compare predictions with new samples that none of them has seen, tile by tile.
///
/// Parameters
/// ----------
/// color : (H, W, 3) array_like of float
///     The new, noisy samples. Missing pixels do not count.
/// candidates : (H, W, K) array_like of float
///     K predictions of the samples' luminance, at least 2. They are a series, such as the predictions that more and
///     more passes of `atrous` return. Pixels where one is not finite do not count.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) array_like of float, optional
///     That of earlier frames, as `choice` returns it.
/// exposure : float, default 1.0
///     `exposure` of the image; above 0. Errors of luminances well below a sixteenth of it count as absolute, of
///     brighter ones as relative.
/// usual : int, default 0
///     The default candidate, relative to which errors are measured.
/// out : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32 array, optional
///     Written and returned instead of a new array; it may be the evidence.
///
/// Returns
/// -------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 2 K) float32
///     With this frame's added: the weighted sums of the gains of the K - 1 steps, negative where a step reduces the
///     error; then those of their squares; then the sum of the samples' weights, and their number.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes, fewer than 2 candidates, or parameters out of range.
///
/// See Also
/// --------
/// choice : Chooses by the evidence.
/// prediction_gain : Compares two histories pixel by pixel.
/// atrous : Returns such predictions.
///
/// Notes
/// -----
/// The gain of step k is ``(a - b)(a + b - 2r)``. Candidates a and b and the sample's luminance r are taken relative to
/// the default candidate: with m its luminance, at least 0, each value v becomes ``(v - m) / (m + exposure / 16)``, and
/// r is then clamped to ±8. Where no sample is clamped, this is an unbiased estimate of the difference of two squared
/// errors (see `prediction_gain`).
///
/// A frame's gains in a tile are weighted by ``1 / √(Σ d² / n + 1e-6)``, over their n samples and all steps, and the
/// squares by its square, so that no frame decides alone.
///
/// Examples
/// --------
/// >>> sample = np.ones((8, 8, 3))
/// >>> candidates = np.stack([np.full((8, 8), 0.5), np.full((8, 8), 1.0)], -1)
/// >>> gain, square, weight, count = yester.compare_candidates(sample, candidates)[0, 0]
/// >>> bool(gain < 0), float(count)
/// (True, 64.0)
#[pyfunction]
#[pyo3(signature = (color, candidates, evidence=None, *, exposure=1.0, usual=0, out=None))]
pub fn compare_candidates<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    candidates: &Bound<'py, PyAny>,
    evidence: Option<&Bound<'py, PyAny>>,
    exposure: f32,
    usual: i128,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    exposure::check(exposure)?;
    let after = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let candidates = Input::<f32>::of_size(candidates, "candidates", Channels::Any, size)?;
        let count = candidates.channels();
        if count < 2 {
            let got = format!("{count} channels");
            return Err(Error::value("candidates", "a channel for each of at least 2", got).into());
        }
        let expected = format!("a candidate, 0 to {}", count - 1);
        let usual = whole("usual", usual, &expected, |&n: &usize| n < count)?;
        let (tiles, numbers) = (choice::tiles(size), choice::channels(count));
        let evidence = Input::<f32>::optional(evidence, "evidence", Channels::Any, tiles)?;
        if let Some(evidence) = &evidence
            && evidence.channels() != numbers
        {
            let expected = format!("{numbers} channels, for {count} candidates");
            let got = format!("{} channels", evidence.channels());
            return Err(Error::value("evidence", expected, got).into());
        }
        let out = Out::given(out, &[tiles.height, tiles.width, numbers])?;
        let color = color.pixels();
        let candidates = candidates.pixels();
        let evidence = evidence.as_ref().map(|evidence| evidence.pixels());
        out.fill(py, |after| {
            let candidates = candidates.to_planes();
            let views: Vec<_> = (0..count).map(|k| candidates.view().channel(k)).collect();
            let mut sums = match evidence {
                Some(evidence) => evidence.to_interleaved(),
                None => Interleaved::new(tiles, numbers),
            };
            choice::compare(&color, &views, exposure, usual, &mut sums);
            after.copy_from_slice(sums.pixels().elements().0);
        })?
    };
    after.array()
}

/// Compare three frames' samples and two results, tile by tile, to tell noise from detail.
///
/// Parameters
/// ----------
/// planes : (H, W, 5) array_like of float
///     Luminances, all where the pixels are in this frame: of its samples; of those of the frame before; of those of
///     two frames before, which were first brought to the frame before; of two results of the frame before. A pixel
///     counts if all are finite in its 3×3 pixels, so that the image's border does not.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) array_like of float, optional
///     That of earlier frames, as `collocation_shares` returns it.
/// exposure : float, default 1.0
///     `exposure` of the image; above 0. Detail below 1/1024 of it is black.
/// out : (⌈H/8⌉, ⌈W/8⌉, 14) float32 array, optional
///     Written and returned instead of a new array; it may be the evidence.
///
/// Returns
/// -------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) float32
///     With this frame's added: weighted sums of products of detail, and the number of pixels.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or an exposure out of range.
///
/// See Also
/// --------
/// collocation_shares : Tells by the evidence how samples and results are best mixed.
///
/// Notes
/// -----
/// The detail of a plane is its difference from the mean of the 3×3 pixels. With the planes numbered from 0, the
/// products are those of 00, 01, 02, 11, 12, 22, 03, 13, 33, 04, 14, 44 and 34. A frame's sums in a tile of n pixels
/// have the weight ``1 / (max(Σ₀₀ + Σ₁₁, Σ₂₂/16, Σ₃₃/16, Σ₄₄/16) / n + (exposure / 1024)²)``, so that no frame decides
/// alone; the tile adds nothing if a sum is infinite.
///
/// Examples
/// --------
/// >>> rng = np.random.default_rng(1)
/// >>> image = rng.random((64, 64, 1))
/// >>> noisy = image + 0.1 * rng.normal(size=(64, 64, 3))
/// >>> evidence = yester.collocate(np.dstack([noisy, image, 0 * image]))
/// >>> motion, coverage = np.zeros((64, 64, 2)), np.ones((64, 64))
/// >>> shares, evidence = yester.collocation_shares(evidence, motion, coverage)
/// >>> bool(shares[..., 0].mean() > 0.95), bool(shares[..., 1].mean() < 0.05)
/// (True, True)
#[pyfunction]
#[pyo3(name = "collocate", signature = (planes, evidence=None, *, exposure=1.0, out=None))]
pub fn collocate_<'py>(
    py: Python<'py>,
    planes: &Bound<'py, PyAny>,
    evidence: Option<&Bound<'py, PyAny>>,
    exposure: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    exposure::check(exposure)?;
    let after = {
        let planes = Input::<f32>::new(planes, "planes", Channels::Of(&[collocation::PLANES]))?;
        let tiles = choice::tiles(planes.size());
        let evidence = Input::<f32>::optional(evidence, "evidence", EVIDENCE, tiles)?;
        let out = Out::given(out, &[tiles.height, tiles.width, collocation::CHANNELS])?;
        let planes = planes.pixels();
        let evidence = evidence.as_ref().map(|evidence| evidence.pixels());
        out.fill(py, |after| {
            let mut sums = match evidence {
                Some(evidence) => evidence.to_interleaved(),
                None => collocation::nothing(planes.size),
            };
            collocation::collocate(&planes, exposure, &mut sums);
            after.copy_from_slice(sums.pixels().elements().0);
        })?
    };
    after.array()
}

/// Channels of the evidence that `collocate` returns.
const EVIDENCE: Channels = Channels::Of(&[collocation::CHANNELS]);

/// Find how samples and two results are best mixed, tile by tile, by the evidence of earlier frames.
///
/// Parameters
/// ----------
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) array_like of float
///     The previous frame's, as `collocate` returns it.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Motion in pixels. A tile's evidence comes from where its centre does.
/// coverage : (H, W) array_like of float
///     Above 0 where the pixel's surface was visible in the previous frame (see `reproject`); tiles whose centre was
///     not have no evidence.
/// share : float, default 0.2
///     Fraction of the evidence that decays per frame; 0 to 1.
/// out : tuple of (⌈H/8⌉, ⌈W/8⌉, 2) and (⌈H/8⌉, ⌈W/8⌉, 14) float32 arrays, optional
///     Written and returned, as shares and evidence, instead of new arrays. A part may be None.
///
/// Returns
/// -------
/// shares : (⌈H/8⌉, ⌈W/8⌉, 2) float32
///     Shares λ and g, 0 to 1: with samples y and results a and b, ``m = b + λ (a - b)`` has the least error among
///     mixtures of both results, and ``m + g (y - m)`` among those of it and the samples. To hide the tiles,
///     interpolate between their centres.
/// evidence : (⌈H/8⌉, ⌈W/8⌉, 14) float32
///     The evidence where the tiles are in this frame, decayed: `collocate` adds this frame's.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or a share out of range.
///
/// See Also
/// --------
/// collocate : Adds a frame's evidence.
/// choice : Chooses one of several predictions by how well they predict samples.
/// TAA : Mixes samples, denoised colour and result in this way.
///
/// Notes
/// -----
/// Samples y of a frame, p of the frame before and q of two frames before measure one signal, with independent noise.
/// With ⟨a b⟩ the products, averaged over a tile and its neighbours with weights {1, 2, 1}/4 along each axis (those at
/// the border are repeated beyond it),
/// ``S = ⟨y p⟩ ⟨p q⟩ / ⟨y q⟩`` is the energy of the detail in p, whatever motion and resampling have lost: the triple
/// collocation of [1]_. ⟨y q⟩ is at least 0.1 of √(⟨y y⟩ ⟨q q⟩), and S at most ⟨p p⟩. ``N = ⟨p p⟩ - S`` is the energy
/// of p's noise, and with ``r = ⟨y p⟩ / S`` the samples y / r have the detail of p.
///
/// The squared error of b less that of a is then ``E = ⟨b b⟩ - ⟨a a⟩ - 2 (⟨y b⟩ - ⟨y a⟩) / r``, and
/// ``λ = 1/2 + E / 2⟨(a - b)²⟩``. The share of samples is Wiener's, ``g = 1 - (N - C) / ⟨(p - m)²⟩``, where
/// ``C = ⟨p m⟩ - ⟨y m⟩ / r``, from 0 to N / 2, is the noise that m has of p. Both are limited to 0 and 1; with fewer
/// than 16 pixels in the average, both are 0.
///
/// References
/// ----------
/// .. [1] A. Stoffelen, "Toward the true near-surface wind speed: Error modeling and calibration using triple
///    collocation", Journal of Geophysical Research 103(C4), 1998.
///
/// Examples
/// --------
/// See `collocate`.
#[pyfunction]
#[pyo3(signature = (evidence, motion, coverage, *, share=collocation::SHARE, out=None))]
#[pyo3(text_signature = "(evidence, motion, coverage, *, share=0.2, out=None)")]
pub fn collocation_shares<'py>(
    py: Python<'py>,
    evidence: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    coverage: &Bound<'py, PyAny>,
    share: f32,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(Bound<'py, PyArrayDyn<f32>>, Bound<'py, PyArrayDyn<f32>>)> {
    from_0_to_1("share", share)?;
    let [shares, carried] = {
        let motion = Input::<f32>::new(motion, "motion", MOTION)?;
        let size = motion.size();
        let coverage = Input::<f32>::of_size(coverage, "coverage", Channels::One, size)?;
        let tiles = choice::tiles(size);
        let evidence = Input::<f32>::of_size(evidence, "evidence", EVIDENCE, tiles)?;
        let shapes = [collocation::SHARES, collocation::CHANNELS]
            .map(|channels| [tiles.height, tiles.width, channels]);
        let shapes = shapes.each_ref().map(|shape| &shape[..]);
        let [evidence, motion, coverage] = [&evidence, &motion, &coverage].map(Input::pixels);
        fill_parts(py, out.as_ref(), shapes, |[shares, carried]| {
            let (found, rest) = collocation::shares(evidence, motion, coverage.plane(), share);
            found.view().interleave(shares);
            carried.copy_from_slice(rest.pixels().elements().0);
        })?
    };
    Ok((shares.array()?, carried.array()?))
}

/// Measure how much of a frame's noise is that of the frame before.
///
/// Renderers that begin every frame with the same random numbers make noise that sticks to the screen, and a frame that
/// is shown twice has no new noise. Methods that compare frames take such noise for detail.
///
/// Parameters
/// ----------
/// color, previous : (H, W, 3) array_like of float
///     New samples, and those of the frame before; illumination (see `demodulate`) if there is albedo. Missing pixels
///     do not count.
/// motion : (H, W, 2) or (H, W, 3) array_like of float
///     Motion in pixels from this frame to the one before.
/// deviation : (2 ⌈H/8⌉, W) array_like of float, optional
///     The previous frame's result; none for the second frame of a sequence.
/// out : (2 ⌈H/8⌉, W) float32 array, optional
///     Written and returned, as the deviation, instead of a new array.
///
/// Returns
/// -------
/// repetition : float
///     0 to 1; 0 of fewer than 256 pairs of pixels. Of illumination, seven sequences with independent noise had at most
///     0.09, and 0.52 and more with one seed for all frames (``python -m yester.study.compare.repeated``). Pipelines
///     take more than 0.3 for repeated noise.
/// deviation : (2 ⌈H/8⌉, W) float32
///     For the next frame: ρ in every eighth row and the row below, NaN where it is unknown.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes.
///
/// See Also
/// --------
/// choice, collocation_shares : Assume independent noise.
///
/// Notes
/// -----
/// With y the luminance of `color` and p that of `previous`, fetched along the motion, ``ρ = (y - p) / (|y| + |p|)``,
/// and ``δ = ρ(x) - ρ(x + 1)`` leaves out slow changes of light. Detail that moves with its surface cancels in ρ. Noise
/// that sticks to the screen correlates by ``C = min(corr(δ, δ'), corr(δᵥ, δᵥ'))``, with δ' of the frame before and
/// ``δᵥ = ρ(x) - ρ(x↓)``, ↓ the row below. Independent noise makes these correlate by 0 to -½, or by ¼ where it has
/// moved by one pixel along the difference, which it cannot do for both. Where nothing moves, ρ of repeated noise is 0:
/// S is the share of pairs of which y(x) is that of `previous` and ``|ε|`` is above 1/10, with
/// ``ε = (y(x) - y(x + 1)) / (|y(x)| + |y(x + 1)|)``. Textures and mirrors repeat as well, but their rows resemble one
/// another: ``V = corr(δ, δ↓)`` and ``W = corr(ε, ε↓)``. The repetition is
/// ``max(0, C - max(V, 0), S - max(W, 0))``, with ``corr(a, b) = Σ a b / max(√(Σ a² Σ b²), n / 100)`` over n pairs:
/// deviations below a tenth are no noise that matters.
///
/// Examples
/// --------
/// >>> noise = np.random.default_rng(0).uniform(size=(64, 64, 3))
/// >>> repetition, deviation = yester.repetition(noise, noise, np.zeros((64, 64, 2)))
/// >>> repetition > 0.3
/// True
#[pyfunction]
#[pyo3(name = "repetition", signature = (color, previous, motion, deviation=None, *, out=None))]
pub fn repetition_<'py>(
    py: Python<'py>,
    color: &Bound<'py, PyAny>,
    previous: &Bound<'py, PyAny>,
    motion: &Bound<'py, PyAny>,
    deviation: Option<&Bound<'py, PyAny>>,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<(f32, Bound<'py, PyArrayDyn<f32>>)> {
    let mut share = 0.0;
    let found = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let previous = Input::<f32>::of_size(previous, "previous", COLOR, size)?;
        let motion = Input::<f32>::of_size(motion, "motion", MOTION, size)?;
        let rows = repetition::looked_at(size);
        let deviation = Input::<f32>::optional(deviation, "deviation", Channels::One, rows)?;
        let out = Out::given(out, &[rows.height, rows.width])?;
        let [color, previous, motion] = [&color, &previous, &motion].map(|image| image.pixels());
        let deviation = deviation.as_ref().map(|image| image.pixels().plane());
        let share = &mut share;
        out.fill(py, |found| {
            let [now, before] = [color, previous].map(repetition::luminances);
            let (most, image) =
                repetition::repetition(now.view(), before.view(), motion, deviation);
            *share = most;
            found.copy_from_slice(image.plane(0));
        })?
    };
    Ok((share, found.array()?))
}

/// Measure how much better one history predicts the new sample than another, without a reference.
///
/// Parameters
/// ----------
/// candidate, base : (H, W, 3) array_like of float
///     Two predictions of `color`, both independent of it.
/// color : (H, W, 3) array_like of float
///     The new, noisy samples. A pixel that is missing in one of the three does not count.
/// ids : (H, W) array_like of int, optional
///     Only pixels of the same id are averaged.
/// radius : int, default 3
///     Radius of the window in pixels, 0 to 16.
/// standardized : bool, default False
///     Divide the gain by √(s² / n + 0.01²), where s² is the variance over the n pixels of the window: Student's t,
///     with a standard error of at least 1 %. This tells gains from chance, but is no longer unbiased.
/// out : (H, W) float32 array, optional
///     Written and returned instead of a new array; it may be an input.
///
/// Returns
/// -------
/// gain : (H, W) float32
///     The mean over the window of ``Σ (k - h)(k + h - 2c) / (Σ h² + 0.01)``, sums over channels: an unbiased estimate
///     of the difference of relative squared errors, negative where `candidate` is better. 0 without valid pixels, and
///     standardized with fewer than two.
///
/// Raises
/// ------
/// ValueError
///     On wrong shapes or a radius out of range.
///
/// See Also
/// --------
/// compare_candidates : Compares a series of predictions, tile by tile.
/// virtual_motion : Motion of the reflections' history.
///
/// Notes
/// -----
/// ``(k - c)² - (h - c)²`` is linear in c, so that the noise of c averages out; after a tone curve or a clamp it would
/// not.
///
/// Examples
/// --------
/// >>> color = np.ones((4, 4, 3))
/// >>> gain = yester.prediction_gain(color, 0.5 * color, color)
/// >>> gain[0].round(4)
/// array([-0.9868, -0.9868, -0.9868, -0.9868], dtype=float32)
#[pyfunction]
#[pyo3(signature = (candidate, base, color, *, ids=None, radius=3, standardized=false, out=None))]
pub fn prediction_gain<'py>(
    py: Python<'py>,
    candidate: &Bound<'py, PyAny>,
    base: &Bound<'py, PyAny>,
    color: &Bound<'py, PyAny>,
    ids: Option<&Bound<'py, PyAny>>,
    radius: i128,
    standardized: bool,
    out: Option<Bound<'py, PyAny>>,
) -> PyResult<Bound<'py, PyArrayDyn<f32>>> {
    let radius = whole("radius", radius, "0 to 16 pixels", |&n| {
        n <= prediction::MOST
    })?;
    let gain = {
        let color = Input::<f32>::new(color, "color", COLOR)?;
        let size = color.size();
        let candidate = Input::<f32>::of_size(candidate, "candidate", COLOR, size)?;
        let base = Input::<f32>::of_size(base, "base", COLOR, size)?;
        let ids = Input::<u32>::optional(ids, "ids", Channels::One, size)?;
        let out = Out::given(out, &[size.height, size.width])?;
        let [candidate, base, color] = [&candidate, &base, &color].map(|image| image.pixels());
        let ids = ids.as_ref().map(|ids| ids.pixels());
        out.fill(py, |gain| {
            let gain = plane_bands(gain, size);
            prediction::prediction_gain(candidate, base, color, ids, radius, standardized, gain);
        })?
    };
    gain.array()
}
