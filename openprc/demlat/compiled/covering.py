"""Covering strips of elements with as few run blocks as possible."""

from __future__ import annotations

from typing import Any

from openprc.demlat.compiled.jit import entry


@entry
def cover(stamp: int) -> Any:
    """``cover(first, new_strip, width, least, block, lane)``.

    Parameters
    ----------
    first : (E,) i4
        First node of every element, ascending within a strip.
    new_strip : (E,) bool
        Where a strip begins.
    width : int
        Lanes of a block.
    least : float
        Fewer elements than this make no block.
    block, lane : (E,) i4
        Set to where every element goes; `lane` stays -1 where it goes nowhere.

    Returns
    -------
    int
        Number of blocks. Beginning each at the first element that is not covered yet is
        optimal for points on a line.
    """

    def cover(first, new_strip, width, least, block, lane):
        _ = stamp
        count = 0
        at = 0
        while at < first.size:
            stop = at + 1
            twins = False
            while stop < first.size and not new_strip[stop] and first[stop] < first[at] + width:
                # Twins at one place would need the same lane.
                twins = twins or first[stop] == first[stop - 1]
                stop += 1
            if twins or stop - at < least:
                at += 1
                continue
            for e in range(at, stop):
                block[e] = count
                lane[e] = first[e] - first[at]
            count += 1
            at = stop
        return count

    return cover
