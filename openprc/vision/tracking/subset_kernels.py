"""The inner loops of subset matching."""

# ruff: noqa: TID253, ANN001, ANN201, ANN202 - compiled: types are those of the caller.

from __future__ import annotations

import numpy as np

from openprc.vision.tracking.compiling import inner, kernel

_F = np.float32
_SIXTH, _TWO_THIRDS, _HALF, _ONE = _F(1.0 / 6.0), _F(2.0 / 3.0), _F(0.5), _F(1.0)


@inner
def _measure(c, warp, f, gx, gy, offset, mean, g, sums):
    """Sum over a window what the normal equations need, in one pass over the image."""
    side = f.shape[0]
    left, top = int(np.floor(warp[0])), int(np.floor(warp[1]))
    x0, y0 = _F(warp[0] - left), _F(warp[1] - top)
    xx, xy, yx, yy = _F(1.0 + warp[2]), _F(warp[3]), _F(warp[4]), _F(1.0 + warp[5])
    ox, oy = _F(offset[0]), _F(offset[1])
    for k in range(15):
        sums[k] = 0.0
    for j in range(side):
        dy = oy + _F(j)
        xr, yr = x0 + xy * dy, y0 + yy * dy
        for i in range(side):
            dx = ox + _F(i)
            x, y = xr + xx * dx, yr + yx * dx
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
            r1 = (
                c[q + 1, p] * a0
                + c[q + 1, p + 1] * a1
                + c[q + 1, p + 2] * a2
                + c[q + 1, p + 3] * a3
            )
            r2 = (
                c[q + 2, p] * a0
                + c[q + 2, p + 1] * a1
                + c[q + 2, p + 2] * a2
                + c[q + 2, p + 3] * a3
            )
            r3 = (
                c[q + 3, p] * a0
                + c[q + 3, p + 1] * a1
                + c[q + 3, p + 2] * a2
                + c[q + 3, p + 3] * a3
            )
            g[i] = r0 * b0 + r1 * b1 + r2 * b2 + r3 * b3 - mean
        s0 = s1 = s2 = u0 = u1 = u2 = v0 = v1 = v2 = _F(0.0)
        for i in range(side):
            dx = ox + _F(i)
            value = g[i]
            s0 += value
            s1 += value * value
            s2 += value * f[j, i]
            t = value * gx[j, i]
            u0 += t
            t *= dx
            u1 += t
            u2 += t * dx
            t = value * gy[j, i]
            v0 += t
            t *= dx
            v1 += t
            v2 += t * dx
        d = np.float64(dy)
        sums[0] += s0
        sums[1] += s1
        sums[2] += s2
        sums[3] += u0
        sums[4] += u1
        sums[5] += u0 * d
        sums[6] += u2
        sums[7] += u1 * d
        sums[8] += u0 * d * d
        sums[9] += v0
        sums[10] += v1
        sums[11] += v0 * d
        sums[12] += v2
        sums[13] += v1 * d
        sums[14] += v0 * d * d


@inner
def _inside(warp, offset, side, height, width):
    low_x, high_x, low_y, high_y = np.inf, -np.inf, np.inf, -np.inf
    for k in range(4):
        dx = offset[0] + (side - 1) * (k & 1)
        dy = offset[1] + (side - 1) * (k >> 1)
        x = warp[0] + (1.0 + warp[2]) * dx + warp[3] * dy
        y = warp[1] + warp[4] * dx + (1.0 + warp[5]) * dy
        low_x, high_x = min(low_x, x), max(high_x, x)
        low_y, high_y = min(low_y, y), max(high_y, y)
    slack = 1e-4
    return (
        low_x >= slack
        and low_y >= slack
        and high_x <= width - 1 - slack
        and high_y <= height - 1 - slack
    )


@kernel
def refine(
    c,
    shape,
    ids,
    guesses,
    values,
    gradient_x,
    gradient_y,
    offset,
    mean,
    energy,
    mean_jacobian,
    value_jacobian,
    hessian,
    inverse,
    translation,
    max_iterations,
    tolerance,
    max_shift,
    warps,
    zncc,
    rest,
    gain,
    reason,
    iterations,
):
    """Match templates, starting from guesses; `rest` is the residual's sum of squares."""
    height, width = shape
    side = values.shape[1]
    n_pixels = side * side
    spread = 0.5 * side
    g = np.empty(side, np.float32)
    sums = np.empty(15)
    b = np.empty(6)
    step = np.empty(6)
    for n in range(len(ids)):
        warp = warps[n]
        for k in range(6):
            warp[k] = guesses[n, k]
        zncc[n] = rest[n] = gain[n] = np.nan
        iterations[n] = 0
        t = ids[n]
        if t < 0 or not np.isfinite(warp).all():
            reason[n] = 1
            continue
        if translation:
            warp[2:] = 0.0
        if not _inside(warp, offset[t], side, height, width):
            reason[n] = 2
            continue
        reason[n] = 3
        before = np.inf
        rate = 0.3
        for iteration in range(max_iterations):
            iterations[n] = iteration + 1
            _measure(
                c, warp, values[t], gradient_x[t], gradient_y[t], offset[t], _F(mean[t]), g, sums
            )
            product = sums[2]
            square = sums[1] - sums[0] * sums[0] / n_pixels
            if not square > 1e-12 * energy[t]:
                reason[n] = 4
                break
            scale = np.sqrt(square / energy[t])
            for k in range(6):
                # px, py, a, b, c, d from the order of the sums: 1, dx, dy of either gradient
                m = (0, 6, 1, 2, 7, 8)[k]
                b[k] = sums[3 + m] - sums[0] * mean_jacobian[t, m] - product * value_jacobian[t, m]
            explained = 0.0
            if translation:
                hxx, hyy, hxy = hessian[t, 0, 0], hessian[t, 6, 6], hessian[t, 0, 6]
                det = hxx * hyy - hxy * hxy
                step[:] = 0.0
                step[0] = (hyy * b[0] - hxy * b[1]) / det
                step[1] = (hxx * b[1] - hxy * b[0]) / det
            else:
                for k in range(6):
                    step[k] = 0.0
                    for m in range(6):
                        step[k] += inverse[t, k, m] * b[m]
            for k in range(6):
                explained += step[k] * b[k]
                step[k] /= scale
            rest[n] = max(square - product * product / energy[t] - explained, 0.0)
            gain[n] = scale
            zncc[n] = np.sqrt(max(1.0 - rest[n] / square, 0.0))
            if product < 0.0:
                zncc[n] = -zncc[n]
            # warp <- warp o step^-1
            sxx, sxy, syx, syy = 1.0 + step[2], step[3], step[4], 1.0 + step[5]
            det = sxx * syy - sxy * syx
            if not det > 0.1:
                reason[n] = 5
                break
            ixx, ixy, iyx, iyy = syy / det, -sxy / det, -syx / det, sxx / det
            ipx = -(ixx * step[0] + ixy * step[1])
            ipy = -(iyx * step[0] + iyy * step[1])
            wxx, wxy, wyx, wyy = 1.0 + warp[2], warp[3], warp[4], 1.0 + warp[5]
            warp[0] += wxx * ipx + wxy * ipy
            warp[1] += wyx * ipx + wyy * ipy
            warp[2] = wxx * ixx + wxy * iyx - 1.0
            warp[3] = wxx * ixy + wxy * iyy
            warp[4] = wyx * ixx + wyy * iyx
            warp[5] = wyx * ixy + wyy * iyy - 1.0
            if not (1.0 + warp[2]) * (1.0 + warp[5]) - warp[3] * warp[4] > 0.1:
                reason[n] = 5
                break
            if np.hypot(warp[0] - guesses[n, 0], warp[1] - guesses[n, 1]) > max_shift:
                break
            if not _inside(warp, offset[t], side, height, width):
                reason[n] = 2
                break
            length = np.sqrt(
                step[0] ** 2
                + step[1] ** 2
                + spread**2 / 3.0 * (step[2] ** 2 + step[3] ** 2 + step[4] ** 2 + step[5] ** 2)
            )
            if iteration > 0:
                rate = min(length / before, 0.9)
            before = length
            if length * rate / (1.0 - rate) < tolerance:
                reason[n] = 0
                break
