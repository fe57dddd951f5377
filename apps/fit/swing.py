"""Period and decrement of a decaying swing."""
import numpy as np
from scipy.optimize import least_squares


def swing(time_s, x, periods=5, guess_s=None):
    """Returns (period, s; logarithmic decrement a period) of x about its rest: a decaying cosine over so many periods from the first turning point on.
    x falls or rises first. NaN: x does not turn."""
    time_s, x = np.asarray(time_s, float), np.asarray(x, float)
    if np.ptp(x) <= 0:
        return float("nan"), float("nan")
    x = x if x.mean() < x[0] else -x
    # The first turning point: the lowest value until x has come back over its middle; the next one by half a period.
    below = x < (x.max() + x.min()) / 2
    first = int(np.argmax(below))
    back = first + int(np.argmin(below[first:])) if not below[first:].all() else len(x)
    low = first + int(np.argmin(x[first:back]))
    if guess_s is None:
        again = back + int(np.argmax(below[back:])) if back < len(x) and below[back:].any() else len(x)
        after = back + int(np.argmax(x[back:again])) if back < len(x) else low
        guess_s = 2 * (time_s[after] - time_s[low])
    if low in (0, len(x) - 1) or not guess_s > 0:
        return float("nan"), float("nan")
    use = (time_s >= time_s[low]) & (time_s <= time_s[low] + periods * guess_s)
    t, y = time_s[use] - time_s[low], x[use]

    def lack(p):
        return p[0] * np.exp(-p[1] * t) * np.cos(2 * np.pi * t / p[2] + p[3]) + p[4] - y
    size = max(np.ptp(y) / 2, 1e-12)
    found = least_squares(lack, [-size, 2.0, guess_s, 0.0, float(np.mean(y))], x_scale=[size, 1, guess_s, 1, size]).x
    return float(found[2]), float(found[1] * found[2])
