"""Options turned into flags mean the same options again."""

from __future__ import annotations

import tyro
from hypothesis import given
from hypothesis import strategies as st

from pocketgs.capture.options import CaptureOptions
from pocketgs.cli.flags import flags_of

OPTIONS = st.builds(
    CaptureOptions,
    images=st.none() | st.sampled_from(["images_4", "a folder"]),
    downscale=st.none() | st.floats(1.0, 16.0),
    max_size=st.none() | st.integers(1, 4000),
    background=st.none() | st.tuples(st.floats(0, 1), st.floats(0, 1), st.floats(0, 1)),
    lens=st.sampled_from(["undistort", "direct", "ignore"]),
    hold_out=st.just(0) | st.integers(2, 20),
)


@given(OPTIONS)
def test_flags_give_the_options_back(options: CaptureOptions) -> None:
    assert tyro.cli(CaptureOptions, args=list(flags_of(options))) == options


def test_defaults_need_no_flags() -> None:
    assert flags_of(CaptureOptions()) == ()
    assert flags_of(CaptureOptions(lens="ignore", downscale=2.0)) == ("--downscale", "2.0", "--lens", "ignore")
