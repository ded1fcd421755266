"""Made-up runs and outcomes of the steering experiments."""

import numpy as np
import pandas as pd


def curves(experiment="origin", *, board=False, stances=20, unseen=(4,), by="planner"):
    """Return three curves of one run, as the experiments write them."""
    k = np.arange(stances)
    if experiment.startswith("turn"):
        heading = np.pi * k / (stances - 1)
        x, y = 0.55 * np.sin(heading), 0.55 * (1 - np.cos(heading))
    else:
        heading = np.full(stances, np.pi + 0.1)
        x, y = 1 - k / (stances - 1), 0.1 * np.sin(k / 3)
    parts = []
    for name, shift in (("measured", 0.0), ("response", 0.01), ("pure", 0.08)):
        part = pd.DataFrame(
            {"curve": name, "stance": k, "time_s": 0.62 * k, "x_m": x + shift * k / stances,
             "y_m": y + shift, "heading_rad": heading + shift}
        )  # fmt: skip
        if name == "measured":
            part.loc[list(unseen), ["x_m", "y_m", "heading_rad"]] = np.nan
        if name == "response":
            part.loc[0, ["x_m", "y_m", "heading_rad"]] = np.nan
        part["board_m"] = (
            np.linspace(-0.5, 0.4, stances) if board and name == "measured" else np.nan
        )
        parts.append(part)
    return pd.concat(parts, ignore_index=True).assign(
        experiment=experiment, run=0, controller=by, near=0.15, success=by == "planner",
        board_first_m=-0.5 if board else np.nan, board_x=-1.0 if board else np.nan,
        board_y=0.0 if board else np.nan,
    )  # fmt: skip


def way_points(points=((0.5, 0.0), (0.5, 0.6), (0.0, 0.3))):
    """Return a run through way-points, which are rows of the same table."""
    run = curves()
    rows = pd.DataFrame(points, columns=["x_m", "y_m"]).assign(curve="point")
    whole = pd.concat([run, rows], ignore_index=True)
    known = ["run", "controller", "near", "success"]
    return whole.assign(experiment="waypoints", **run[known].iloc[0])


def film(frames=12):
    """Return the markers of a run in evenly spaced frames."""
    body = np.array([[0.13, 0.03, 0.3], [-0.08, 0.11, 0.32], [-0.07, -0.14, 0.3]])
    boom = np.array([[-0.2, 0.0, 0.2]])
    rows = []
    for k in range(frames):
        centre = [1 - k / frames, 0.1, 0.1 * (k % 4)]
        for name, place in zip(
            ("body1", "body2", "body3", "boom"),
            np.concatenate([body, boom]) + centre,
            strict=True,
        ):
            rows.append((0.1 * k - 0.2, name, *place))
    return pd.DataFrame(rows, columns=["time_s", "marker", "x_m", "y_m", "z_m"])


RATES = {"printed": 0.1, "planner": 0.95, "random": 0.0, "none": 0.0, "ceiling": 1.0}
EXPERIMENTS = ("origin", "turn", "origin_board", "turn_board")


def runs(starts=10, seeds=3):
    rng = np.random.default_rng(np.random.SeedSequence(2))
    rows = []
    for experiment in EXPERIMENTS:
        for controller, rate in RATES.items():
            for k in range(starts * seeds):
                success = rng.random() < rate
                hops = int(rng.integers(20, 40)) if success else -1
                rows.append(
                    (1 + k % seeds, experiment, controller, k // seeds, success, hops)
                )
    columns = ["seed", "experiment", "controller", "run", "success", "hops"]
    return pd.DataFrame(rows, columns=columns)


def outcomes(table):
    return table[["experiment", "controller"]].drop_duplicates()


HORIZONS = pd.DataFrame({"horizon": [1, 3, 6], "runs": 10, "succeeded": [0, 1, 9]})
