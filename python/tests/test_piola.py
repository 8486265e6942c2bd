"""The module from outside, as its users have it."""

import concurrent.futures
import copy
import functools
import json
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
import warnings
from pathlib import Path

import numpy as np
import pytest

import piola
from piola._frames import read_frames

EXAMPLES = os.path.join(os.path.dirname(__file__), "..", "..", "examples")
SPRING = "potential spring\ndimensions 3\nparameter c in J/m^7, c > 0\npsi(l) = c/2*L*(l/L - 1)^2\n"


def plate(**more):
    scene = {
        "body": {"box": [[0, 0], [1, 0.5]], "spacing": 0.1},
        "horizon": {"spacings": 3},
        "material": {"potential": "javili2020", "parameters": {"C1": 1.0, "C2": 0.1}},
        "sets": {"left": "X < 0.1", "right": "X > 0.9"},
        "prescribe": [
            {"set": "left", "u": [0, 0]},
            {"set": "right", "u": ["0.1*t", 0]},
        ],
        "probe": [{"name": "middle", "at": [0.55, 0.45]}],
        "steps": {"increments": 2},
    }
    return {**scene, **more}


def test_laws_are_their_formulas():
    law = piola.Law(SPRING, c=3.0)
    l, L = np.linspace(0.5, 2, 7), 1.25
    assert np.allclose(law.psi(l, L), 1.5 * L * (l / L - 1) ** 2, rtol=1e-15)
    assert np.allclose(law.d1(l, L), 3.0 * (l / L - 1), rtol=1e-15)
    assert np.allclose(law.d2(l, L), 3.0 / L, rtol=1e-15)
    grid = law.psi(l[:, None], np.array([1.0, 2.0]))
    assert grid.shape == (7, 2)
    assert law.parameters == {"c": 3.0} and law.units == {"c": "J/m^7"} and law.arguments == ["l"]
    assert "psi" in law.latex and law._repr_latex_() == law.latex
    assert "spring" in repr(law)


def test_the_library_and_gradients():
    assert "gent" in piola.library()
    law = piola.Law("neo_hooke", {"lambda": "2 GPa"}, mu=1e9, dimension=3)
    F = np.eye(3) + 0.1 * np.random.default_rng(1).standard_normal((5, 4, 3, 3))
    psi, P = law.psi(F), law.P(F)
    assert psi.shape == (5, 4) and P.shape == F.shape
    # P is the derivative of psi, by central differences.
    G = np.random.default_rng(2).standard_normal((3, 3))
    h = 1e-6
    slope = (law.psi(F + h * G) - law.psi(F - h * G)) / (2 * h)
    assert np.allclose(slope, (P * G).sum((-2, -1)), rtol=1e-7)
    clique = piola.Law("javili2020", C1=1.0, C2=2.0, C3=0.0)
    assert np.all(clique.psi([1.0, 1.1], 1.0, measure="v") == 0.0)
    sums = "potential terms\ndimensions 3\nparameter mu(2) in Pa\nparameter alpha(2)\n"
    sums += "psi(F) = sum(k, mu(k)/alpha(k)*(tr(C) - 3 - 2*ln(J)))\n"
    of_vector = piola.Law(sums, mu=[1.0, "2 Pa"], alpha=np.array([1.0, 4.0]))
    assert of_vector.psi(np.diag([2.0, 1.0, 1.0])) == pytest.approx(1.5 * (3 - 2 * np.log(2)))
    vector = piola.Law("ogden", _needed("ogden"))
    assert vector.psi(np.eye(3)) == pytest.approx(0.0, abs=1e-9)


def _needed(name):
    """Ones for the parameters of a potential of the library that have no default."""
    given = {}
    while True:
        try:
            piola.Law(name, given)
            return given
        except piola.Error as error:
            missing = [line.split("`")[1] for line in str(error).splitlines() if "missing" in line]
            assert missing and missing[0] not in given, error
            given.update(dict.fromkeys(missing, 1.0))


def test_mistakes_are_exceptions_with_places():
    with pytest.raises(piola.Error) as raised:
        piola.Law("potential p\npsi(l) = C1*(l/L - 1)^2\n")
    [finding] = raised.value.findings
    assert (finding["code"], finding["line"], finding["column"]) == ("unknown-name", 2, 10)
    assert "C1" in str(raised.value)
    for wrong in (
        lambda: piola.Law("gnt"),
        lambda: piola.Law("gent"),
        lambda: piola.Law(SPRING, c=-1.0),
        lambda: piola.Law(SPRING, c=1.0).psi([1.0], [0.0]),
        lambda: piola.Law(SPRING, c=1.0).P(np.eye(3)),
        lambda: piola.Law("neo_hooke", {"lambda": 1e9}, mu=1e9, dimension=3).P(np.eye(2)),
        lambda: piola.Scene("nowhere.toml").run(),
        lambda: piola.Scene(plate()).energy(np.zeros(3)),
        lambda: piola.Scene(plate()).energy(np.zeros((2, 50))),
        lambda: piola.Law(SPRING, c=None),
        lambda: piola.Law(SPRING, c=True),
        lambda: piola.Law(SPRING, {"c": 1.0}, c=1.0),
        lambda: piola.sweep(plate()),
        lambda: piola.Scene(plate(), {"body.nothing": {1, 2}}),
    ):
        with pytest.raises(piola.Error):
            wrong()
    with pytest.raises(piola.Error) as raised:
        piola.Scene(plate(), {"body.spacing": 0.3}).run()
    assert raised.value.findings[0]["code"] == "extent-not-a-multiple"
    with pytest.raises(piola.Error) as raised:
        piola.Scene(plate(), {"body.spacing": 0.3}).energy()
    assert raised.value.findings[0]["code"] == "extent-not-a-multiple"


def test_scenes_run_and_leave_arrays():
    told = []
    result = piola.Scene(plate()).run(progress=told.append)
    assert result.summary["exit_reason"] == "completed"
    assert result.displacement.shape == (50, 2)
    assert result.displacement[:, 0].max() == pytest.approx(0.1)
    assert len(result.reactions["t"]) == 2 and "middle_u" in result.probes
    last = result.frames[-1]
    assert last.t == 1.0 and last["displacement"].shape == (50, 3)
    assert np.array_equal(last["displacement"][:, :2], result.displacement)
    assert result._repr_png_().startswith(b"\x89PNG")
    pictures = [result.picture(), result.picture("displacement_x", at=0.0), result.picture(force="right")]
    assert all(picture.startswith(b"\x89PNG") for picture in pictures)
    assert len(set(pictures)) == 3
    with pytest.raises(piola.Error, match="no field"):
        result.picture("colour")
    assert told == sorted(told) and all(0 <= part <= 1 for part in told)
    # Overrides of the scene and of the call; a law of one's own.
    law = "potential own\nparameter C1\npsi(l) = C1*(l/L - 1)^2\n"
    own = plate(material={"potential": law, "parameters": {"C1": 1.0}})
    one = piola.Scene(own, {"steps.increments": 1})
    twice = one.run(C1=2.0).reactions["right_x"] / one.run().reactions["right_x"]
    assert twice == pytest.approx(2.0)
    as_law = piola.Scene(plate(material={"potential": piola.Law(law, C1=2.0)}), {"steps.increments": 1})
    assert np.array_equal(as_law.run().reactions["right_x"], one.run(C1=2.0).reactions["right_x"])
    # A copy lives on without what it was made from.
    copied = copy.deepcopy(as_law)
    del as_law
    assert copied.run().reactions["t"].size == 1


def test_laws_scenes_and_results_go_to_other_processes_and_back():
    law = piola.Law("potential own\nparameter C1\npsi(l) = C1*(l/L - 1)^2\n", C1=2.0)
    again = pickle.loads(pickle.dumps(law))
    assert again.given == law.given and again.d1(1.5, 1.0) == law.d1(1.5, 1.0)
    scene = piola.Scene(plate(material={"potential": law}), {"steps.increments": 1})
    here = [scene.run(C1=value) for value in (1.0, 2.0)]
    spawned = multiprocessing.get_context("spawn")
    with concurrent.futures.ProcessPoolExecutor(1, mp_context=spawned) as pool:
        there = list(pool.map(functools.partial(run_with, scene), (1.0, 2.0)))
    for one, other in zip(here, there):
        assert one.folder != other.folder
        assert np.array_equal(one.displacement, other.displacement)
        assert np.array_equal(one.frames[-1]["residual"], other.frames[-1]["residual"])


def run_with(scene, value):
    return scene.run(C1=value)


def test_results_stay_where_they_are_wanted(tmp_path):
    out = tmp_path / "out"
    result = piola.Scene(plate()).run(out)
    assert (out / "picture.png").exists() and result.folder == str(out)
    with pytest.raises(piola.Error):
        piola.Scene(plate()).run(out)
    piola.Scene(plate()).run(out, force=True)
    kept = piola.Scene(plate()).run()
    folder = kept.folder
    assert os.path.exists(folder)
    del kept
    assert not os.path.exists(folder)


def test_energies_and_their_derivatives():
    body = piola.Scene(plate()).body()
    assert body.positions.shape == (50, 2) and body.interactions["bonds"] > 0
    rng = np.random.default_rng(3)
    u, p = 0.01 * rng.standard_normal((2, 50, 2))
    energy = body.energy(u)
    h = 1e-6
    slope = (float(body.energy(u + h * p)) - float(body.energy(u - h * p))) / (2 * h)
    assert slope == pytest.approx((energy.gradient * p).sum(), rel=1e-6)
    assert np.array_equal(energy.forces, -energy.gradient)
    assert float(energy) == energy.value == sum(energy.parts.values())
    tangent = energy.tangent()
    product = energy.product(p)
    assert abs(tangent - tangent.T).max() == 0
    scale = np.abs(product).max()
    assert np.abs(tangent @ p.reshape(-1) - product.reshape(-1)).max() < 1e-13 * scale
    operator = energy.operator()
    assert np.array_equal(operator @ p.reshape(-1), product.reshape(-1))
    both = operator @ np.stack([p.reshape(-1), 2 * p.reshape(-1)], axis=1)
    assert np.array_equal(both[:, 0], product.reshape(-1))
    # Its own solver in three lines: the equilibrium that a run finds.
    from scipy.sparse.linalg import spsolve

    x = body.positions
    u = np.zeros_like(x)
    u[:, 0] = 0.1 * (x[:, 0] > 0.9)
    free = np.flatnonzero(np.repeat((x[:, 0] > 0.1) & (x[:, 0] < 0.9), 2))
    for _ in range(8):
        at = body.energy(u)
        u.reshape(-1)[free] -= spsolve(at.tangent()[free][:, free], at.gradient.reshape(-1)[free])
    assert np.abs(u - piola.Scene(plate()).run().displacement).max() < 1e-9


def test_plans_moduli_and_calibration():
    scene = piola.Scene(plate())
    assert scene.plan()["points"] == 50
    moduli = scene.moduli()
    assert json.dumps(moduli)
    found = scene.calibrate({"E": 2e5}, "C1", {"material.parameters.C2": 0.0})
    assert set(found) == {"C1"}
    assert scene.check() is None


def test_sweeps_are_tables():
    study = piola.sweep(piola.Scene(plate()), C1=[1.0, 2.0, -1.0])
    assert len(study) == 3
    assert list(study["material.parameters.C1"]) == [1.0, 2.0, -1.0]
    energies = study["energy"]
    assert energies[1] > energies[0] and np.isnan(energies[2])
    assert study.rows[2]["state"] == "refused"
    assert set(study.units) <= set(study.to_dict()) and len(list(study)) == 3
    with pytest.raises(KeyError):
        study["nothing"]
    first = piola.sweep(plate(), C1=[-1.0, 1.0])
    assert [row["state"] for row in first.rows] == ["refused", "reached"]
    assert len(piola.sweep(plate(), C1="1:2:3")) == 3
    study = piola.sweep(plate(), {"body.spacing": [0.1, 0.05]}, C1=np.linspace(1, 2, 2))
    assert len(study) == 4
    with pytest.raises(piola.Error):
        piola.sweep(plate(), C9=[1, 2])


def test_steps_are_followed_and_loaded():
    scene = piola.Scene(plate(), {"steps.increments": 3})
    plain = [step.displacement for step in scene.steps()]
    assert len(plain) == 3
    assert np.array_equal(plain[-1], scene.run().displacement)
    loaded = []
    for step in scene.steps():
        if step.t < 0.5:
            # A force upwards on the points inside.
            step.loads[20:30, 1] = 1e-4
        loaded.append(step.displacement)
    assert np.array_equal(loaded[0], plain[0])
    assert loaded[1][20:30, 1].mean() > plain[1][20:30, 1].mean() + 1e-4
    replaced = []
    for step in scene.steps():
        step.loads = step.loads + (step.t < 0.5) * 1e-4 * (np.arange(50) // 10 == 2)[:, None] * [0, 1]
        replaced.append(step.displacement)
    assert np.array_equal(replaced[1], loaded[1])
    with pytest.raises(piola.Error):
        for step in scene.steps():
            step.loads = np.zeros(3)
    with pytest.raises(piola.NotConverged):
        list(scene.steps({"solver.tolerance": 1e-19, "solver.max_iterations": 3}))
    # A loop that ends early leaves nothing behind.
    for step in scene.steps():
        break
    with pytest.raises(piola.Error):
        next(iter(piola.Scene(os.path.join(EXAMPLES, "wave", "scene.toml")).steps()))


def test_what_should_be_known_is_a_warning():
    idle = plate(load=[{"set": "left", "force": [1.0, 0.0]}])
    with pytest.warns(piola.PiolaWarning, match="prescribed"):
        piola.Scene(idle).run()


def test_runs_that_do_not_converge_keep_what_did():
    scene = piola.Scene(plate(), {"solver.tolerance": 1e-19, "solver.max_iterations": 3})
    with pytest.raises(piola.NotConverged) as raised:
        scene.run()
    assert raised.value.result.summary["exit_reason"] == "not_converged"
    # An equilibrium that is not stable is an error with a result.
    thin = plate(body={"box": [[0, 0], [1, 0.2]], "spacing": 0.1})
    del thin["probe"]
    thin["prescribe"] = [{"set": "left", "u": [0, 0]}, {"set": "right", "u": ["-0.5*t", 0]}]
    with pytest.raises(piola.Error, match="not stable") as raised, pytest.warns(piola.PiolaWarning):
        piola.Scene(thin, {"steps.increments": 10}).run()
    assert raised.value.result.summary["exit_reason"] == "completed"


@pytest.mark.skipif(sys.platform == "win32", reason="signals of Unix")
def test_an_interrupt_ends_a_run_after_its_step(tmp_path):
    out = tmp_path / "out"
    scene = piola.Scene(plate(), {"body.spacing": 0.01, "steps.increments": 1000})
    threading.Timer(1.5, lambda: os.kill(os.getpid(), signal.SIGINT)).start()
    start = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        scene.run(out)
    assert time.monotonic() - start < 60
    assert piola.Result(str(out)).summary["exit_reason"] == "interrupted"
    # And what comes after is not disturbed.
    assert piola.Scene(plate()).run().summary["exit_reason"] == "completed"


def test_threads_of_python_go_on_while_a_scene_is_solved():
    counted = []
    over = threading.Event()

    def count():
        while not over.is_set():
            counted.append(1)
            time.sleep(0.001)

    thread = threading.Thread(target=count)
    thread.start()
    piola.Scene(plate(), {"body.spacing": 0.02}).run()
    over.set()
    thread.join()
    assert len(counted) > 20


def test_the_command_is_there():
    piola_command = os.path.join(os.path.dirname(sys.executable), "piola")
    found = subprocess.run([piola_command, "--version"], capture_output=True, text=True, check=True)
    assert found.stdout.startswith("piola ")
    wrong = subprocess.run([piola_command, "check", "nowhere.piola"], capture_output=True, text=True)
    assert wrong.returncode == 2 and "nowhere.piola" in wrong.stderr


def test_bodies_of_meshes():
    ring = piola.Scene(os.path.join(EXAMPLES, "ring", "scene.toml"))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        result = ring.run()
    assert result.probes["outside_u"][-1] == pytest.approx(6.67e-6, rel=0.02)


def test_large_arrays_are_evaluated_piece_by_piece_as_small_ones():
    law = piola.Law("javili2020", C1=1.0, C2=0.0, C3=0.0)
    l = np.linspace(0.5, 1.5, 100_001)
    rest = np.linspace(1.0, 2.0, 100_001)
    whole = law.derivatives(l, rest, "l")
    pieces = [law.derivatives(l[k : k + 7], rest[k : k + 7], "l") for k in (0, 4090, 8192, 99_994)]
    for start, piece in zip((0, 4090, 8192, 99_994), pieces, strict=True):
        for column, part in zip(whole, piece, strict=True):
            assert np.array_equal(column[start : start + 7], part)


def test_frames_in_pieces_are_put_together() -> None:
    """Two processes have each written their part of 3 x 4 points, with borrowed ones between them."""
    folder = Path(__file__).parent / "data" / "pieces"
    rest, end = read_frames(str(folder))
    assert (rest.t, end.t) == (0.0, 1.0)
    place = [(0.05 + 0.1 * i, 0.05 + 0.1 * j, 0.0) for i in range(3) for j in range(4)]
    assert np.allclose(end.positions, place, atol=1e-15)
    assert "point" not in end.fields
    assert np.array_equal(end["held"], [float(j in (0, 3)) for _ in range(3) for j in range(4)])
    upper = end["displacement"].reshape(3, 4, 3)[:, 3]
    assert np.array_equal(upper, [[0.0, 0.01, 0.0]] * 3)
    # The force on the upper row is that on the lower one, turned round.
    residual = end["residual"].reshape(3, 4, 3)
    assert abs(residual[:, 3, 1].sum() + residual[:, 0, 1].sum()) < 1e-12 * residual[:, 3, 1].sum()
