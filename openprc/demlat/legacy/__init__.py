"""The stepping of openprc up to 0.1.1, for reproducing runs that it stored.

Nothing else should use it: it is of first order and feeds energy into the motion. See
`openprc.demlat.legacy.run`.
"""
