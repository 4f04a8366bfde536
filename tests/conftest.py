"""What all tests share."""

from hypothesis import settings

# The same examples in every run, so that a change and not chance decides; `--hypothesis-profile=default` explores.
settings.register_profile("repeatable", derandomize=True, deadline=None)
settings.load_profile("repeatable")
