import numpy as np
import pytest

from hopdata.maps.subspaces import (
    arc_length,
    bootstrap_subspaces,
    pooled_frame,
    principal_angles,
    principal_subspaces,
)


def section_normals(n_markers):
    """Return unit normals (12B, 2) of both sections, which fix the mean height of the B markers."""
    normals = np.zeros((12 * n_markers, 2))
    for column in (0, 1):
        start = 6 * n_markers * column
        normals[start + 2 : start + 3 * n_markers : 3, column] = n_markers**-0.5
    return normals


def angles_to_sections(kept):
    """Return principal angles between the two dropped components and the section normals."""
    dropped = np.linalg.svd(kept)[0][:, -2:]
    return principal_angles(dropped, section_normals(len(kept) // 12))


def planted(rng, n, *, noise=1e-3, markers=3, maps=1):
    """Return pairs on the graph of one (or two) linear maps between two sections."""
    half = 6 * markers
    normal = section_normals(markers)[:half, :1]
    # Orthonormal directions within the section, so that x spans all of it.
    within = np.linalg.svd(normal.T, full_matrices=True)[2][1:].T
    slopes = rng.normal(size=(maps, half - 1, half - 1)) / 3
    label = np.arange(n) % maps
    inputs = rng.normal(size=(n, half - 1))
    outputs = np.einsum("np,npq->nq", inputs, slopes[label])
    outputs += noise * rng.normal(size=outputs.shape)
    x, y = inputs @ within.T, outputs @ within.T
    graph = np.vstack([within @ np.eye(half - 1), within @ slopes[0].T])
    return x + 0.4 * normal.T, y - 0.3 * normal.T, label, np.linalg.qr(graph)[0]


@pytest.mark.parametrize("markers", [3, 4])
def test_a_planted_map_is_found(markers):
    x, y, _, graph = planted(np.random.default_rng(0), 400, markers=markers)
    study = bootstrap_subspaces(x, y, ["1>2"] * 400, seed=1, bootstraps=20, samples=60)
    assert study.bases["1>2"].shape == (20, 12 * markers - 2, 6 * markers - 1)
    frame = pooled_frame(x, y)
    assert np.degrees(angles_to_sections(frame)).max() < 1e-6
    in_pairs = frame @ study.bases["1>2"]
    assert arc_length(in_pairs, graph).max() < 0.02


def test_components_are_those_of_the_library():
    from sklearn.decomposition import PCA

    rng = np.random.default_rng(7)
    pairs = rng.normal(size=(60, 12)) * np.geomspace(1, 0.05, 12)
    draws = np.array([rng.choice(60, 30, replace=False) for _ in range(5)])
    bases, _ = principal_subspaces(pairs, draws, 4)
    for rows, basis in zip(draws, bases, strict=True):
        expected = PCA(n_components=4).fit(pairs[rows]).components_.T
        assert arc_length(basis, expected) < 1e-12
    other = PCA(n_components=4).fit(pairs[draws[1]]).components_.T
    assert arc_length(bases[0], other) > 1e-3


@pytest.mark.parametrize("landings", [2, 20, 36, 37, 200])
def test_the_pooled_frame_is_complete_for_any_number_of_landings(landings):
    x, y, _, _ = planted(np.random.default_rng(8), landings)
    frame = pooled_frame(x, y)
    assert frame.shape == (36, 34)
    np.testing.assert_allclose(frame.T @ frame, np.eye(34), atol=1e-12)
    pairs = np.hstack([x, y])
    centred = pairs - pairs.mean(axis=0)
    # The section conditions vary by rounding, and what is left out is no more than that.
    np.testing.assert_allclose(centred @ frame @ frame.T, centred, atol=1e-9)


def test_bases_are_orthonormal_and_leading():
    rng = np.random.default_rng(1)
    pairs = rng.normal(size=(50, 10)) * np.geomspace(1, 0.01, 10)
    draws = np.array([np.arange(30), np.arange(20, 50)])
    bases, full = principal_subspaces(pairs, draws, 4)
    assert full.all()
    np.testing.assert_allclose(
        bases.swapaxes(1, 2) @ bases, [np.eye(4)] * 2, atol=1e-14
    )
    covariance = np.cov(pairs[draws[1]].T)
    largest = np.sort(np.linalg.eigvalsh(covariance))[::-1][:4]
    np.testing.assert_allclose(
        np.diag(bases[1].T @ covariance @ bases[1]), largest, rtol=1e-12
    )


def test_two_maps_stand_apart_and_one_does_not():
    x, y, label, _ = planted(np.random.default_rng(2), 600, maps=2)
    apart = bootstrap_subspaces(
        x, y, np.array(["a", "b"])[label], seed=1, bootstraps=30
    )
    halves = np.where(np.arange(600) < 300, "a", "b")
    same = bootstrap_subspaces(
        x[label == 0], y[label == 0], halves[::2], seed=1, bootstraps=30
    )
    assert arc_length(apart.bases["a"], apart.bases["b"]).min() > 1.0
    assert arc_length(same.bases["a"], same.bases["b"]).max() < 0.5


def test_section_normals_are_the_mean_heights():
    normals = section_normals(4)
    np.testing.assert_allclose(normals.T @ normals, np.eye(2), atol=1e-15)
    pairs = np.random.default_rng(3).normal(size=48)
    heights = pairs[2:12:3].mean(), pairs[26:36:3].mean()
    np.testing.assert_allclose(pairs @ normals / 2, heights)


def test_other_constraints_than_the_sections_show_in_the_angles():
    x, y, _, _ = planted(np.random.default_rng(4), 200)
    x[:, 0], y = 1.0, y + 0.1 * np.random.default_rng(5).normal(size=y.shape)
    assert np.degrees(angles_to_sections(pooled_frame(x, y))).max() > 45


def test_pooled_frame_with_fewer_landings_than_dimensions():
    x, y, _, _ = planted(np.random.default_rng(6), 9)
    frame = pooled_frame(x, y)
    assert frame.shape == (36, 34)
    np.testing.assert_allclose(frame.T @ frame, np.eye(34), atol=1e-13)
    assert (np.diff(np.std(np.hstack([x, y]) @ frame, axis=0)) <= 1e-13).all()


def test_classes_that_are_too_small_or_flat_are_named():
    x, y, _, _ = planted(np.random.default_rng(7), 110)
    x[80:], y[80:] = x[80], y[80]
    schedule = np.array(["1>2"] * 51 + ["2>1"] * 29 + ["flat"] * 30)
    study = bootstrap_subspaces(x, y, schedule, seed=1, bootstraps=5)
    assert list(study.bases) == ["1>2"]
    assert study.notes == [
        {
            "what": "subspaces of schedule flat",
            "reason": "5 of 5 draws have fewer than 17 components",
        },
        {
            "what": "subspaces of schedule 2>1",
            "reason": "29 touchdowns, 30 distinct ones wanted in each draw",
        },
    ]


def test_many_rare_schedules_are_counted_together():
    x, y, _, _ = planted(np.random.default_rng(7), 100)
    schedule = ["1>2"] * 60 + [str(k % 12) for k in range(40)]
    study = bootstrap_subspaces(x, y, schedule, seed=1, bootstraps=5)
    assert list(study.bases) == ["1>2"]
    assert study.notes == [
        {
            "what": "subspaces of 12 schedules",
            "reason": "3 to 4 touchdowns each, 40 in all, 30 distinct ones wanted in each draw",
        }
    ]


def test_more_components_than_a_draw_can_have_are_refused_with_the_remedy():
    x, y, _, _ = planted(np.random.default_rng(8), 100, markers=6)
    study = bootstrap_subspaces(
        x, y, ["1>2"] * 100, seed=1, bootstraps=5, components=35
    )
    assert study.bases == {}
    assert "span at most 29 of 70 dimensions, 35 wanted" in study.notes[0]["reason"]
    mended = bootstrap_subspaces(x, y, ["1>2"] * 100, seed=1, bootstraps=5, samples=48)
    assert mended.bases["1>2"].shape == (5, 70, 35)
    assert mended.notes == []


@pytest.mark.parametrize(
    ("markers", "components"), [(4, 23), (5, 29), (6, 29), (8, 29)]
)
def test_many_body_markers_take_as_many_components_as_a_draw_spans(markers, components):
    x, y, _, _ = planted(np.random.default_rng(8), 100, markers=markers)
    study = bootstrap_subspaces(x, y, ["1>2"] * 100, seed=1, bootstraps=5)
    assert study.bases["1>2"].shape == (5, 12 * markers - 2, components)
    said = [note["what"] for note in study.notes]
    printed = 6 * markers - 1
    assert said == ([f"29 components instead of {printed}"] if printed > 29 else [])


def test_a_schedule_keeps_its_draws_when_others_come_and_go():
    x, y, _, _ = planted(np.random.default_rng(9), 200)
    one = bootstrap_subspaces(
        x, y, np.array(["a", "b"])[np.arange(200) % 2], seed=1, bootstraps=5
    )
    two = bootstrap_subspaces(
        x, y, np.array(["a", ""])[np.arange(200) % 2], seed=1, bootstraps=5
    )
    assert list(two.bases) == ["a"]
    assert np.array_equal(one.bases["a"], two.bases["a"])
