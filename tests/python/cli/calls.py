"""Commands as a shell would call them."""

from typing import Any

import pytest

from sim2vr_harness.cli.main import main


def call(capsys: Any, *arguments: str) -> tuple[int, str, str]:
    """Exit status, standard output and standard error."""
    with pytest.raises(SystemExit) as exit_:
        main(list(arguments))
    out, err = capsys.readouterr()
    return int(exit_.value.code or 0), out, err
