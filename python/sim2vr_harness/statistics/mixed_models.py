"""Linear mixed models: fixed effects of factors, a random intercept per unit."""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from typing import Any


def mixed_model(
    episodes: Any, measure: str, factors: Mapping[str, str], levels: Sequence[Sequence[str]]
) -> dict[str, Any]:
    """Fit measure ~ factors and their interactions + (1 | unit) by REML.

    Rounds of one unit share its intercept, so that they do not count as independent.

    Args:
        episodes: A row per round, with ``unit``.
        measure: The dependent variable.
        factors: Categorical predictors: name and column of ``episodes``.
        levels: Of each, in order; the first is what the others are compared with.

    Returns:
        ``formula``, ``groups``, ``rounds``, ``converged``, ``unit_variance``,
        ``residual_variance`` and ``effects``: per fixed effect ``name``, ``estimate``, ``error``,
        ``z``, ``p``, ``low``, ``high`` (95 %).

    Raises:
        ValueError: The model cannot be fitted to these rows.
    """
    import numpy as np
    import statsmodels.formula.api as smf

    frame, terms = _frame(episodes, measure, list(factors.values()), levels)
    formula = f"value ~ {' * '.join(terms) or '1'}"
    try:
        with warnings.catch_warnings():  # what they say is in `converged` and the variances
            warnings.simplefilter("ignore")
            fit = smf.mixedlm(formula, frame, groups=frame["unit"]).fit(reml=True)
    except (np.linalg.LinAlgError, ValueError) as error:
        raise ValueError(f"the model does not fit: {error}") from error
    return {
        "formula": f"{measure} ~ {' * '.join(factors) or '1'} + (1 | unit)",
        "groups": int(frame["unit"].nunique()),
        "rounds": len(frame),
        "converged": bool(fit.converged),
        "unit_variance": float(fit.cov_re.iloc[0, 0]),
        "residual_variance": float(fit.scale),
        "effects": _effects(fit, list(factors)),
    }


def _frame(
    episodes: Any, measure: str, columns: Sequence[str], levels: Sequence[Sequence[str]]
) -> tuple[Any, list[str]]:
    """Return the data frame of the model, and its terms: factors with two levels or more."""
    import pandas as pd

    table = episodes.dropna(subset=[measure])
    frame = pd.DataFrame(
        {"value": table[measure].to_numpy(float), "unit": table["unit"].to_numpy()}
    )
    terms = []
    for number, (column, own) in enumerate(zip(columns, levels, strict=True)):
        present = [label for label in own if label in set(table[column])]
        frame[f"f{number}"] = pd.Categorical(table[column], categories=present)
        if len(present) > 1:
            terms.append(f"C(f{number})")
    return frame, terms


def _effects(fit: Any, factors: Sequence[str]) -> list[dict[str, Any]]:
    """Return the fixed effects of a fitted model, the intercept first."""
    intervals = fit.conf_int()
    return [
        {
            "name": _plain(name, factors),
            "estimate": float(fit.fe_params[name]),
            "error": float(fit.bse_fe[name]),
            "z": float(fit.tvalues[name]),
            "p": float(fit.pvalues[name]),
            "low": float(intervals.loc[name, 0]),
            "high": float(intervals.loc[name, 1]),
        }
        for name in fit.fe_params.index
    ]


def _plain(name: str, factors: Sequence[str]) -> str:
    """``C(f0)[T.hard]:C(f1)[T.b]`` -> ``difficulty=hard:version=b``."""
    for number, factor in enumerate(factors):
        name = name.replace(f"C(f{number})[T.", f"{factor}=")
    return name.replace("]", "")
