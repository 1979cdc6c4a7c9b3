"""Pictures of little density, wherever a test of the command line or of a report draws some."""

import pytest

from tests.test_hysid.command import coarse_pictures


@pytest.fixture(scope="module", autouse=True)
def _nobody_looks_at_the_pictures():
    with coarse_pictures():
        yield
