"""The inner loops of subset matching.

The warp parameters are px, py, a, b, c, d, q0 ... q5, of which two, six or twelve are free. The
point of a template at (dx, dy) from its tracked point is looked for at

    x = px + (1 + a) dx + b dy + q0 dx² + q1 dx dy + q2 dy²
    y = py + c dx + (1 + d) dy + q3 dx² + q4 dx dy + q5 dy²
"""

# ruff: noqa: ANN001, ANN201, ANN202 - compiled: types are those of the caller.

from __future__ import annotations

import numpy as np

from openprc.vision.tracking.compiling import inner, kernel

ACCEPTED, NO_TEMPLATE, LEFT_IMAGE, NOT_CONVERGED, BELOW_GATE, SINGULAR = range(6)
N_SUMS = 15  # of g, g², g f, and of g times every column of the Jacobian
#: A window may not shrink to less than this share of its area: nothing of it would be left.
_SMALLEST = 0.1
#: Single precision may put the outermost pixels of a window a little further out [px].
_SLACK = 1e-4
#: Steps shorter than this are taken for the end of a linear convergence [px].
_NEAR = 0.3
#: Variance of an image, over that of the template, below which there is nothing to match.
_FLAT = 1e-10
#: A bent window does not put the point further than this from where the affine one is [px].
_BENT_SHIFT = 1.0

_F = np.float32
_SIXTH, _TWO_THIRDS, _HALF, _ONE = _F(1.0 / 6.0), _F(2.0 / 3.0), _F(0.5), _F(1.0)


@inner
def _sample(c, x, y, left, top):
    """Interpolate at (left + x, top + y), two pixels of border into the coefficients."""
    fx, fy = np.floor(x), np.floor(y)
    p, q = left + int(fx) + 1, top + int(fy) + 1
    u, v = x - fx, y - fy
    a0, a3 = (_ONE - u) * (_ONE - u) * (_ONE - u) * _SIXTH, u * u * u * _SIXTH
    a1 = _TWO_THIRDS - u * u * (_ONE - _HALF * u)
    a2 = _ONE - a0 - a1 - a3
    b0, b3 = (_ONE - v) * (_ONE - v) * (_ONE - v) * _SIXTH, v * v * v * _SIXTH
    b1 = _TWO_THIRDS - v * v * (_ONE - _HALF * v)
    b2 = _ONE - b0 - b1 - b3
    r0 = c[q, p] * a0 + c[q, p + 1] * a1 + c[q, p + 2] * a2 + c[q, p + 3] * a3
    q += 1
    r1 = c[q, p] * a0 + c[q, p + 1] * a1 + c[q, p + 2] * a2 + c[q, p + 3] * a3
    q += 1
    r2 = c[q, p] * a0 + c[q, p + 1] * a1 + c[q, p + 2] * a2 + c[q, p + 3] * a3
    q += 1
    r3 = c[q, p] * a0 + c[q, p + 1] * a1 + c[q, p + 2] * a2 + c[q, p + 3] * a3
    return r0 * b0 + r1 * b1 + r2 * b2 + r3 * b3


@inner
def _measure(c, warp, curved, store, t, level, g, sums):
    """Sum over a window what the normal equations need, in one pass over the image.

    Single precision inside of a row, with a `level` near the mean taken off so that nothing
    cancels; rows add up in double precision.
    """
    f, gx, gy = store.values[t], store.gradient_x[t], store.gradient_y[t]
    side = f.shape[0]
    mean = _F(level)
    left, top = int(np.floor(warp[0])), int(np.floor(warp[1]))
    x0, y0 = _F(warp[0] - left), _F(warp[1] - top)
    xx, xy, yx, yy = _F(1.0 + warp[2]), _F(warp[3]), _F(warp[4]), _F(1.0 + warp[5])
    q0, q1, q2 = _F(warp[6]), _F(warp[7]), _F(warp[8])
    q3, q4, q5 = _F(warp[9]), _F(warp[10]), _F(warp[11])
    ox, oy = _F(store.offset[t, 0]), _F(store.offset[t, 1])
    for k in range(N_SUMS):
        sums[k] = 0.0
    for j in range(side):
        dy = oy + _F(j)
        xr, yr = x0 + xy * dy, y0 + yy * dy
        if curved:
            xr, yr = xr + q2 * dy * dy, yr + q5 * dy * dy
            xs, ys = xx + q1 * dy, yx + q4 * dy
            for i in range(side):
                dx = ox + _F(i)
                x, y = xr + (xs + q0 * dx) * dx, yr + (ys + q3 * dx) * dx
                g[i] = _sample(c, x, y, left, top) - mean
        else:
            for i in range(side):
                dx = ox + _F(i)
                g[i] = _sample(c, xr + xx * dx, yr + yx * dx, left, top) - mean
        s0 = s1 = s2 = u0 = u1 = u2 = v0 = v1 = v2 = _F(0.0)
        for i in range(side):
            dx = ox + _F(i)
            value = g[i]
            s0 += value
            s1 += value * value
            s2 += value * f[j, i]
            part = value * gx[j, i]
            u0 += part
            part *= dx
            u1 += part
            u2 += part * dx
            part = value * gy[j, i]
            v0 += part
            part *= dx
            v1 += part
            v2 += part * dx
        d = np.float64(dy)
        a0, a1, a2 = np.float64(u0), np.float64(u1), np.float64(u2)
        b0, b1, b2 = np.float64(v0), np.float64(v1), np.float64(v2)
        plain = np.float64(s0), np.float64(s1), np.float64(s2), a0, b0, a1, a0 * d, b1, b0 * d
        curvature = a2, a1 * d, a0 * d * d, b2, b1 * d, b0 * d * d
        for k in range(9):
            sums[k] += plain[k]
        for k in range(6):
            sums[9 + k] += curvature[k]


@inner
def _reach(warp, corner, side):
    """Return first and last column and row of a warped window."""
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for k in range(9):
        dx = corner[0] + 0.5 * (side - 1) * (k % 3)
        dy = corner[1] + 0.5 * (side - 1) * (k // 3)
        x = warp[0] + (1.0 + warp[2]) * dx + warp[3] * dy
        y = warp[1] + warp[4] * dx + (1.0 + warp[5]) * dy
        x += warp[6] * dx * dx + warp[7] * dx * dy + warp[8] * dy * dy
        y += warp[9] * dx * dx + warp[10] * dx * dy + warp[11] * dy * dy
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    return low_x, high_x, low_y, high_y


@inner
def _within(reach, low_x, high_x, low_y, high_y):
    return reach[0] >= low_x and reach[1] <= high_x and reach[2] >= low_y and reach[3] <= high_y


@inner
def _advance(warp, step, free):
    """warp <- warp o step^-1, its curvature to first order; False where that is singular."""
    det = (1.0 + step[2]) * (1.0 + step[5]) - step[3] * step[4]
    if not det > _SMALLEST:
        return False
    ixx, ixy = (1.0 + step[5]) / det, -step[3] / det
    iyx, iyy = -step[4] / det, (1.0 + step[2]) / det
    ipx = -(ixx * step[0] + ixy * step[1])
    ipy = -(iyx * step[0] + iyy * step[1])
    wxx, wxy, wyx, wyy = 1.0 + warp[2], warp[3], warp[4], 1.0 + warp[5]
    warp[0] += wxx * ipx + wxy * ipy
    warp[1] += wyx * ipx + wyy * ipy
    warp[2] = wxx * ixx + wxy * iyx - 1.0
    warp[3] = wxx * ixy + wxy * iyy
    warp[4] = wyx * ixx + wyy * iyx
    warp[5] = wyx * ixy + wyy * iyy - 1.0
    if free > 6:
        for k in range(6, 9):
            warp[k] -= wxx * step[k] + wxy * step[k + 3]
            warp[k + 3] -= wyx * step[k] + wyy * step[k + 3]
    return (1.0 + warp[2]) * (1.0 + warp[5]) - warp[3] * warp[4] > _SMALLEST


@inner
def _solve(inverse, b, free, step):
    """Step of the first `free` parameters; return by how much it lowers the squared residual."""
    explained = 0.0
    step[:] = 0.0
    for k in range(free):
        total = 0.0
        for m in range(free):
            total += inverse[k, m] * b[m]
        step[k] = total
        explained += total * b[k]
    return explained


@inner
def _significance(weight, values):
    """Return v'Wv: for values that are noise of variance s², about s² times their number."""
    total = 0.0
    for k in range(len(values)):
        for m in range(len(values)):
            total += values[k] * weight[k, m] * values[m]
    return total


@inner
def _kept(significance, variance, penalty):
    """Share of parameters that is kept, by the positive part of the James-Stein estimator."""
    return max(1.0 - (penalty * variance / max(significance, 1e-300)) ** 2, 0.0)


@inner
def _cost(kept, significance, variance, n):
    """Share of the variance of free parameters that stays, and of what was drawn off wrongly.

    Of parameters drawn towards zero the noise goes, and a bias comes in its place. How large
    it is follows from their significance, where that is more than noise often makes of it.
    """
    return kept + (1.0 - kept) ** 2 * max(significance / variance / n - 1.7, 0.0)


@inner
def _interpolated_noise(warp, corner, side, table):
    """Share of white noise that interpolation leaves, on average over a window."""
    total = 0.0
    last = len(table) - 1
    for k in range(16):
        dx = corner[0] + (side - 1) * (k % 4) / 3.0
        dy = corner[1] + (side - 1) * (k // 4) / 3.0
        x = warp[0] + (1.0 + warp[2]) * dx + warp[3] * dy
        y = warp[1] + warp[4] * dx + (1.0 + warp[5]) * dy
        total += table[int((x - np.floor(x)) * last)] * table[int((y - np.floor(y)) * last)]
    return total / 16.0


@kernel
def search_boxes(ids, guesses, store, shape, margin, boxes):
    """Find out where in the image windows may come to lie: first and last column and row."""
    height, width = shape
    side = store.values.shape[1]
    warp = np.zeros(12)
    for n in range(len(ids)):
        boxes[n, 0] = boxes[n, 2] = 0
        boxes[n, 1] = boxes[n, 3] = -1
        warp[:6] = guesses[n]
        if ids[n] < 0 or not np.isfinite(warp).all():
            continue
        reach = _reach(warp, store.offset[ids[n]], side)
        if _within(reach, -_SLACK, width - 1 + _SLACK, -_SLACK, height - 1 + _SLACK):
            boxes[n, 0] = max(int(reach[0] - margin), 0)
            boxes[n, 1] = min(int(reach[1] + margin) + 1, width - 1)
            boxes[n, 2] = max(int(reach[2] - margin), 0)
            boxes[n, 3] = min(int(reach[3] + margin) + 1, height - 1)


@inner
def _iterate(c, shape, box, guess, warp, free, store, t, limits, way, work):
    """Move a warp until it stays where it is.

    Return the reason for the end, the residual's sum of squares, the gain of the light, ZNCC, and
    the number of iterations. Right sides of the last normal equations are left in `work`.
    """
    most, tolerance, max_shift = limits
    height, width = shape
    g, sums, b, step, last = work
    side = store.values.shape[1]
    energy, corner = store.energy[t], store.offset[t]
    rest, scale, zncc, level = np.nan, np.nan, np.nan, store.mean[t]
    before, rate, relaxation = np.inf, 0.3, 1.0
    for iteration in range(most):
        reach = _reach(warp, corner, side)
        if not _within(reach, -_SLACK, width - 1 + _SLACK, -_SLACK, height - 1 + _SLACK):
            return LEFT_IMAGE, rest, scale, zncc, iteration
        if not _within(reach, box[0] - _SLACK, box[1] + _SLACK, box[2] - _SLACK, box[3] + _SLACK):
            return NOT_CONVERGED, rest, scale, zncc, iteration
        _measure(c, warp, free > 6, store, t, level, g, sums)
        level += sums[0] / (side * side)
        square = sums[1] - sums[0] * sums[0] / (side * side)
        product = sums[2]
        if not square > _FLAT * energy:
            return BELOW_GATE, rest, scale, zncc, iteration + 1
        scale = np.sqrt(square / energy)
        mean_j, value_j = store.mean_jacobian[t], store.value_jacobian[t]
        for k in range(12):
            b[k] = sums[3 + k] - sums[0] * mean_j[k] - product * value_j[k]
        if free == 2:
            explained = _solve(store.to_translation[t], b, 2, step)
        elif free == 6:
            explained = _solve(store.to_affine[t], b, 6, step)
        else:
            explained = _solve(store.to_quadratic[t], b, 12, step)
        rest = max(square - product * product / energy - explained, 0.0)
        zncc = np.sqrt(max(1.0 - rest / square, 0.0)) * (1.0 if product > 0.0 else -1.0)
        length, along = 0.0, 0.0
        for k in range(free):
            step[k] /= scale
            length += (way[k] * step[k]) ** 2
            along += way[k] ** 2 * step[k] * last[k]
            last[k] = step[k]
        length = np.sqrt(length)
        # Noise in the template makes steps too short or too long in weak directions: Aitken's
        # relaxation learns from the step before by how much.
        if before < np.inf and length < _NEAR:
            relaxation /= min(max(1.0 - along / before**2, 0.2), 2.0)
            relaxation = min(max(relaxation, 0.5), 5.0)
            for k in range(free):
                step[k] *= relaxation
        if not _advance(warp, step, free):
            return SINGULAR, rest, scale, zncc, iteration + 1
        if np.hypot(warp[0] - guess[0], warp[1] - guess[1]) > max_shift:
            return NOT_CONVERGED, rest, scale, zncc, iteration + 1
        if iteration > 0:
            rate = min(length / before, 0.9)
        before = length
        # What a linear convergence at this rate still has before it.
        if length * rate / (1.0 - rate) <= tolerance:
            return ACCEPTED, rest, scale, zncc, iteration + 1
    return NOT_CONVERGED, rest, scale, zncc, most


@inner
def _bent(b, rest, store, t, step, penalty):
    """Say whether the residual of an affine match shows more curvature than noise makes."""
    by_affine = _solve(store.to_affine[t], b, 6, step)
    lowered = _solve(store.to_quadratic[t], b, 12, step)
    variance = max(rest + by_affine - lowered, 0.0) / (store.values.shape[1] ** 2 - 14)
    return _significance(store.weight_q[t], step[6:]) > penalty * variance


@inner
def _explains(rest, rest_q, expected):
    """Say whether curvature explains most of what noise does not; of glare it explains little."""
    return not (rest > 2.0 * expected and rest_q > 0.5 * (rest + expected))


@kernel
def refine(c, shape, ids, guesses, boxes, store, noise_before, options, table, out):
    """Match templates, starting from guesses; `out` holds what is said where nothing is found.

    `options`: free parameters; whether noise decides on them; limits of the iteration (number,
    tolerance and longest way [px]); way of the window's pixels for a unit of each parameter;
    penalties of deformation and of curvature.
    """
    start, weighed, limits, way, penalty_a, penalty_q = options
    side = store.values.shape[1]
    work = (np.empty(side, np.float32), np.empty(N_SUMS), np.empty(12), np.empty(12), np.zeros(12))
    warp, bent = np.empty(12), np.empty(12)
    for n in range(len(ids)):
        t, guess, box = ids[n], guesses[n], boxes[n]
        warp[:6] = guess
        warp[6:] = 0.0
        if t < 0 or not np.isfinite(warp).all():
            out.reason[n] = NO_TEMPLATE
            continue
        free = start
        if free == 2:
            warp[2:6] = 0.0
        if not (1.0 + warp[2]) * (1.0 + warp[5]) - warp[3] * warp[4] > _SMALLEST:
            out.reason[n] = SINGULAR
            continue
        reason, rest, scale, zncc, count = _iterate(
            c, shape, box, guess, warp, free, store, t, limits, way, work
        )
        if weighed and reason == ACCEPTED:
            if _bent(work[2], rest, store, t, work[3], penalty_q):
                bent[:] = warp
                ended, rest_q, scale_q, zncc_q, more = _iterate(
                    c, shape, box, guess, bent, 12, store, t, limits, way, work
                )
                count += more
                # Twelve parameters may run away where six do not.
                shift = np.hypot(bent[0] - warp[0], bent[1] - warp[1])
                expected = (2.0 * noise_before[t] ** 2 + 1.0 / 6.0) * side * side
                better = _explains(rest / scale**2, rest_q / scale_q**2, expected)
                if ended == ACCEPTED and zncc_q >= zncc and shift < _BENT_SHIFT and better:
                    warp[:] = bent
                    rest, scale, zncc, free = rest_q, scale_q, zncc_q, 12
        elif weighed and reason in (NOT_CONVERGED, SINGULAR):
            # Too noisy for six parameters: the deformation of the guess has to do.
            warp[:6] = guess
            free = 2
            reason, rest, scale, zncc, more = _iterate(
                c, shape, box, guess, warp, free, store, t, limits, way, work
            )
            count += more
        out.reason[n], out.iterations[n], out.zncc[n] = reason, count, zncc
        out.warps[n] = warp[:6]
        if reason != ACCEPTED:
            continue
        # Noise of the differences, in grey levels of the template: that of the template and that
        # of the image over the gain, of which interpolation has left a part in the residual.
        residual = rest / scale**2 / (side * side - 2 - free)
        left = _interpolated_noise(warp, store.offset[t], side, table)
        noise = max(residual * (scale**2 + 1.0) / (scale**2 + left), store.floor[t])
        # What is weighed against noise is not to change with the light.
        variance = max(residual * 2.0 / (1.0 + left), 1e-300)
        cost_a, cost_q = 1.0, 1.0
        if weighed and free == 12:
            significance = _significance(store.weight_q[t], warp[6:])
            kept = _kept(significance, variance, penalty_q)
            cost_q = _cost(kept, significance, variance, 6)
            for k in range(6):
                for m in range(6):
                    warp[k] += (1.0 - kept) * store.pull_q[t, k, m] * warp[6 + m]
        if weighed and free > 2:
            significance = _significance(store.weight_a[t], warp[2:6])
            kept = _kept(significance, variance, penalty_a)
            cost_a = _cost(kept, significance, variance, 4)
            for k in range(2):
                for m in range(4):
                    warp[k] += (1.0 - kept) * store.pull_a[t, k, m] * warp[2 + m]
            for m in range(2, 6):
                warp[m] *= kept
            out.warps[n] = warp[:6]
        cost_a, cost_q = cost_a * (free > 2), cost_q * (free > 6)
        for k in range(2):
            v = store.variance[t, :, k]
            total = v[0] + cost_a * (v[1] - v[0]) + cost_q * (v[2] - v[1])
            out.sigma[n, k] = np.sqrt(noise * total)
