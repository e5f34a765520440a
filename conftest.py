"""Settings of every test run.

Property tests draw the same examples each time, so that a run says something about the change
that is tested; ``--hypothesis-profile=explore`` draws new ones. No deadline: machines are busy.
"""

from hypothesis import settings

settings.register_profile("repeatable", deadline=None, derandomize=True)
settings.register_profile("explore", deadline=None, derandomize=False, max_examples=500)
settings.load_profile("repeatable")
