"""Least squares with an interval for each constant, and whether the data determine it at all."""
import numpy as np
from scipy import optimize, stats

SINGULAR = 1e-6  # least eigenvalue of the Fisher matrix, relative to the largest, below which a direction is free
OUTLIER = 4.5    # robust standard deviations
LONGEST = 1e4    # standard deviation of a free direction: of a logarithm, or of a range
WIDE = 3.0       # interval wider than this factor (or this share of a range through 0): determined badly


def fit(evaluate, start, low, high, robust=False, iterations=25):
    """evaluate(x) returns scaled residuals (n,) and their Jacobian (n, p). Returns (x, residuals, Jacobian)."""
    seen = {}

    def at(x):
        key = x.tobytes()
        if key not in seen:
            seen[key] = evaluate(x)
        return seen[key]
    found = optimize.least_squares(lambda x: at(x)[0], start, lambda x: at(x)[1], bounds=(low, high), loss="soft_l1" if robust else "linear",
                                   f_scale=1.0, x_scale="jac", xtol=1e-4, ftol=1e-5, gtol=1e-9, max_nfev=iterations)
    residual, jacobian = at(found.x)
    return found.x, residual, jacobian


def covariance(jacobian, variance):
    """Returns (covariance, eigenvalues of the Fisher matrix ascending, their directions); a free direction gets a large, finite variance."""
    fisher = jacobian.T @ jacobian
    values, directions = np.linalg.eigh(fisher)
    floor = max(values[-1] * SINGULAR**2, variance / LONGEST**2, 1e-300)
    return directions @ np.diag(variance / np.maximum(values, floor)) @ directions.T, values, directions


def summary(x, residual, jacobian, low, high):
    """Returns a dict: interval (p, 2), deviation (p,), correlation (p, p), free directions, t, variance."""
    n, p = jacobian.shape
    freedom = max(n - p, 1)
    variance = float(residual @ residual) / freedom
    cov, values, directions = covariance(jacobian, variance)
    deviation = np.sqrt(np.diag(cov))
    spread = np.maximum(deviation, 1e-150)  # 0 if the fit is exact
    t = float(stats.t.ppf(0.975, freedom))
    free = [directions[:, i] for i in range(p) if values[i] <= SINGULAR * values[-1]] if values[-1] > 0 else list(np.eye(p))
    return {"interval": np.stack([x - t * deviation, x + t * deviation], 1), "deviation": deviation, "correlation": cov / np.outer(spread, spread),
            "free": free, "t": t, "variance": variance, "condition": float(values[-1] / max(values[0], 1e-300)), "freedom": n - p}


def verdict(k, x, found, low, high, log):
    """Returns "" where the data determine constant k, else why they do not."""
    if found["freedom"] < 1:
        return "not identifiable from this: no more values than constants"
    if any(abs(d[k]) > 0.1 for d in found["free"]):
        return "not identifiable from this: the data stay the same along a direction of the constants"
    a, b = found["interval"][k]
    if a <= low[k] and b >= high[k]:
        return "not identifiable from this: the interval is wider than the range"
    if a <= low[k] or b >= high[k]:
        return "one-sided: the interval passes an end of the range"
    if b - a > (np.log(WIDE) if log else 1 / WIDE):
        return "badly determined: the interval is a factor of %.1f wide" % np.exp(b - a) if log else "badly determined: the interval is a third of the range"
    return ""


def profile(evaluate, x, k, at, low, high, iterations=4):
    """Returns the sum of squares with constant k held at `at` and the others fitted anew, from x: a profile of the likelihood."""
    others = [i for i in range(len(x)) if i != k]

    def whole(y):
        z = np.array(x, float)
        z[k] = at
        z[others] = y
        return z
    if not others:
        residual = evaluate(whole([]))[0]
        return float(residual @ residual)

    def inner(y):
        residual, jacobian = evaluate(whole(y))
        return residual, jacobian[:, others]
    _, residual, _ = fit(inner, np.array(x)[others], np.array(low)[others], np.array(high)[others], iterations=iterations)
    return float(residual @ residual)


def outliers(residual):
    """Returns the indices of residuals far from the others, by the median of absolute deviations."""
    middle = np.median(residual)
    spread = 1.4826 * np.median(np.abs(residual - middle))
    return [int(i) for i in np.flatnonzero(np.abs(residual - middle) > OUTLIER * spread)] if spread > 0 and len(residual) >= 10 else []


def gain(jacobian, variance, more):
    """Returns the deviations (p,) with the rows `more` (m, p) measured once more, at the same noise."""
    cov, _, _ = covariance(np.vstack([jacobian, more]), variance)
    return np.sqrt(np.diag(cov))
