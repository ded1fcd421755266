"""One door for atheris: libFuzzer chooses inputs by the lines of hopdata that they reach.

    python tests/fuzz/target.py DOOR CORPUS FINDS [options of libFuzzer]

The first byte of an input chooses the name of the file, and with it the format. Half of
the inputs are made by the damage that knows the format (`hostile.damaged`), the others
by libFuzzer. An input that breaks a promise is put into FINDS, once for each kind of
fault; the one that is read is always in FINDS/current, so that it is there if the
process ends. `long_run.py` starts this.
"""

import hashlib
import os
import sys
import tempfile
import warnings
from pathlib import Path

import atheris
import numpy as np
import oracle

#: Modules whose branches guide the search: those that look at foreign data.
GUIDING = (
    *("hopdata.recordings", "hopdata.config", "hopdata.foreign", "hopdata.samples"),
    *("hopdata.commands", "hopdata.jobs", "hopdata.errors", "hopdata.time_stamps"),
    *("hopdata.steering.live", "hopdata.steering.models", "hopdata.code_cache"),
    *("hopdata.landings.states", "hopdata.recording", "qtm_rt"),
)
LONGEST = 1 << 16


def entered(door, names):
    """Return the function that libFuzzer calls, and its mutator."""
    from hostile import damaged

    finds = Path(sys.argv[3])
    folder = Path(tempfile.mkdtemp(prefix="hopdata-fuzz-"))
    seen = set()
    current = finds / "current"

    def enter(data):
        if not data:
            return
        current.write_bytes(data)
        name = names[data[0] % len(names)]
        verdict = oracle.enter_door(door, name, data[1:], folder)
        if verdict.fault and verdict.signature not in seen:
            seen.add(verdict.signature)
            digest = hashlib.sha256(data).hexdigest()[:12]
            (finds / digest).write_bytes(data)

    def mutate(data, most, seed):
        rng = np.random.Generator(np.random.PCG64(np.random.SeedSequence([seed])))
        if not data or rng.random() < 0.5:
            return atheris.Mutate(data, most)
        name = names[data[0] % len(names)]
        try:
            changed = damaged(name, bytes(data[1:]), rng)
        except Exception:  # the input is too odd for damage that knows its format
            return atheris.Mutate(data, most)
        return bytes([data[0]]) + changed[: most - 1]

    return enter, mutate


def main():
    """Let libFuzzer send inputs through the door."""
    sys.path[:0] = oracle._test_folders()
    door_name, corpus, finds = sys.argv[1:4]
    for one in (corpus, finds):
        Path(one).mkdir(parents=True, exist_ok=True)
    sys.argv[2:4] = [str(Path(corpus).resolve()), str(Path(finds).resolve())]
    with atheris.instrument_imports(include=GUIDING, enable_loader_override=False):
        from doors import DOORS

        from hopdata.foreign.door import open_here

        door = DOORS[door_name]
        names = [*door.sound]
        with open_here():
            oracle.warm_up(door, Path(tempfile.mkdtemp(prefix="hopdata-fuzz-")))
    for number, data in enumerate(door.sound.values()):
        seed = bytes([number]) + data
        digest = hashlib.sha256(seed).hexdigest()[:12]
        Path(sys.argv[2], digest).write_bytes(seed)
    enter, mutate = entered(door, names)
    oracle.guard.temporary = os.path.realpath(tempfile.gettempdir())
    oracle.guard.also = tuple(sys.argv[2:4])
    sys.addaudithook(oracle.guard)
    warnings.simplefilter("error")
    options = [sys.argv[0], sys.argv[2], f"-max_len={LONGEST}", *sys.argv[4:]]
    # What is read in a process of its own would not guide the search.
    with open_here():
        atheris.Setup(options, enter, custom_mutator=mutate)
        atheris.Fuzz()


if __name__ == "__main__":
    main()
