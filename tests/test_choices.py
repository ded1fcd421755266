"""Each choice by name has one table of names, and an unknown name is an error."""

from types import SimpleNamespace

import numpy as np
import pytest

from choices import enumerations, without_products
from hopdata import recording
from hopdata.config.schema import load_schema
from hopdata.figures import style as saving
from hopdata.figures.catalogue import FORMATS
from hopdata.hybrid.methods import table as integrators
from hopdata.hybrid.printed import theorem
from hopdata.landings import schedules, touchdowns
from hopdata.landings.contacts import kink_law as kink_recording
from hopdata.landings.contacts import timing as contacts
from hopdata.landings.sections import select as sections
from hopdata.landings.states import assemble as pair_assembly
from hopdata.landings.states import fits as states
from hopdata.maps import prediction, subspaces
from hopdata.maps.truth import scoring as landing_scores
from hopdata.maps.verdict import words
from hopdata.recordings import (
    axes,
    importing,
)
from hopdata.recordings import (
    external as external_contacts,
)
from hopdata.recordings import (
    external as force_signals,
)
from hopdata.recordings.quality import orientation
from hopdata.report import language
from hopdata.scenes import SCENES
from hopdata.synthesis import camera
from hopdata.synthesis.integrators import INTEGRATORS
from hopdata.synthesis.simulate import Simulation

ANY = SimpleNamespace()  # stands for arguments that are read only after the name
FORCES = {"unit": "lbf", "inverted": False}
NONE = np.empty((0, 3))


def heights(name="kink", gravity="learned"):
    """Look for contacts where there are none."""
    return contacts.find_contacts(
        NONE, NONE, ANY, down_height_m=0.0, method=name, gravity=gravity
    )


# For each table, a call with a name that it may not know.
ASKED = {
    "touchdowns.method": (contacts.METHODS, heights),
    "touchdowns.gravity": (
        kink_recording.GRAVITIES,
        lambda name: heights(gravity=name),
    ),
    "gravity of the priors": (
        kink_recording.GRAVITIES,
        lambda name: kink_recording.weak_priors(3, name),
    ),
    "touchdowns.ambiguous": (
        schedules.TREATMENTS,
        lambda name: touchdowns.touchdown_table(
            ANY, pre_height_m=1.0, post_height_m=0.0, ambiguous=name
        ),
    ),
    "ambiguous pairs": (
        schedules.TREATMENTS,
        lambda name: pair_assembly.assemble_pairs(
            [], ANY, pre_height_m=1.0, post_height_m=0.0, ambiguous=name
        ),
    ),
    "states.method": (states.METHODS, lambda name: section(method=name)),
    "states.gravity": (states.GRAVITIES, lambda name: section(gravity=name)),
    "side of a section": (states.SIDES, lambda name: section(side=name)),
    "sections.rule": (
        sections.RULES,
        lambda name: sections.select_sections([ANY], rule=name),
    ),
    "sections.frames": (
        sections.FRAMES,
        lambda name: sections.select_sections([ANY], frames=name),
    ),
    "true frames": (
        sections.FRAMES,
        lambda name: landing_scores._true_frames(
            SimpleNamespace(body_height=np.zeros(2), foot_down=np.zeros((2, 3), bool)),
            name,
        ),
    ),
    "figures.formats": (
        FORMATS,
        lambda name: saving.save_figure(ANY, "figure", formats=(name,)),
    ),
    "input.vertical_axis": (axes.FILE_AXES, lambda name: axes.rotate_up(NONE, name)),
    "input.unit": (
        orientation.UNITS,
        lambda name: orientation.choose_unit(NONE, unit=name, nominal="m"),
    ),
    "unit to inspect": (
        orientation.UNITS_IN_M,
        lambda name: orientation.guess_unit_and_up(ANY, unit=name),
    ),
    "role": (
        recording.ROLES,
        lambda name: recording.Recording(
            "a", np.empty(0), np.empty((0, 0, 3)), (), (), 1.0
        ).names(name),
    ),
    "markers": (
        importing.ROLE_OF_KEY,
        lambda name: importing._chosen(ANY, ANY, {name: ["a"]}),
    ),
    "contacts.unit": (
        external_contacts.SECONDS_PER_UNIT,
        lambda name: external_contacts.read_contact_times(
            {"file": "a", "unit": name}, feet=[]
        ),
    ),
    "forces.unit": (
        force_signals.NEWTONS_PER_UNIT,
        lambda name: force_signals._signal(
            ANY, ANY, NONE, NONE, {**FORCES, "unit": name}
        ),
    ),
    "conclusion": (
        words.CONCLUSIONS,
        lambda name: words.sentence(name, ANY, "", 0.95, 0.1),
    ),
    "motion_capture.noise_of": (
        camera.NOISE_OF,
        lambda name: camera.MotionCapture(noise_of=name),
    ),
    "simulation.integrator": (INTEGRATORS, lambda name: Simulation(integrator=name)),
    "integrator": (
        integrators.choices(),
        lambda name: integrators.check_method(name, ANY, jacobian=False),
    ),
    "mesh": (theorem.MESHES, lambda name: theorem.mesh_ends(ANY, 0.0, 1.0, name)),
}
# Choices of the configuration, and the tables that they come from.
CONFIGURED = {
    "recordings.contacts.unit": external_contacts.SECONDS_PER_UNIT,
    "recordings.forces.unit": force_signals.NEWTONS_PER_UNIT,
    "input.unit": orientation.UNITS,
    "input.vertical_axis": orientation.UPWARD,
    "sections.rule": sections.RULES,
    "sections.frames": sections.FRAMES,
    "touchdowns.method": contacts.METHODS,
    "touchdowns.gravity": kink_recording.GRAVITIES,
    "touchdowns.ambiguous": schedules.TREATMENTS,
    "states.method": states.METHODS,
    "states.gravity": states.GRAVITIES,
    "prediction.draws": prediction.DRAWS,
    "subspaces.which": subspaces.COMPONENTS,
    "subspaces.draws": subspaces.SUBSPACE_DRAWS,
    "subspaces.incomplete": subspaces.INCOMPLETE,
    "report.language": language.LANGUAGES,
    "figures.formats": FORMATS,
    "simulation.scene": SCENES,
    "simulation.integrator": INTEGRATORS,
    "motion_capture.noise_of": camera.NOISE_OF,
}


def section(method="split_fit", gravity="auto", side="before"):
    """Fit states where there are none."""
    return states.section_states(
        NONE,
        NONE,
        NONE,
        height_m=0.0,
        side=side,
        contact=NONE,
        method=method,
        gravity=gravity,
    )


@pytest.mark.parametrize("choice", ASKED)
def test_an_unknown_name_is_an_error_that_lists_the_known_ones(choice):
    table, ask = ASKED[choice]
    with pytest.raises(Exception, match="expected one of ") as caught:
        ask("no such name")
    assert all(str(name) in str(caught.value) for name in table)
    assert "no such name" in str(caught.value)
    assert "hopdata" in caught.type.__module__ or caught.type is ValueError


def test_the_choices_of_the_configuration_are_those_of_the_tables():
    schema = without_products(load_schema())
    found = {path: set(choices) for path, choices in enumerations(schema)}
    assert found == {path: set(table) for path, table in CONFIGURED.items()}
