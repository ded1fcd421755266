"""Compile, for the wheel, the code that a first `solve` would otherwise compile.

`make release` calls it:

    python packaging/machine_code.py src/hopdata/_machine_code

It compiles the driver, the code that carries Jacobians, the generic steps of explicit
methods, the operations of ranges, and the loop in lanes (as wide as this level has
them; processors of level v4 compile wider ones), for processors of level x86-64-v3
(2013 and later) and for the running Python, Numba and llvmlite. A machine that differs
in one of these compiles as if the wheel had no machine code.
`hopdata.code_cache.brought_code` reads the files.
"""

from __future__ import annotations

import json
import os
import re
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

LEVEL = "x86-64-v3"
FEATURES = [
    "avx", "avx2", "bmi", "bmi2", "cx16", "f16c",
    "fma", "lzcnt", "movbe", "popcnt", "xsave",
]  # fmt: skip
SWITCHES = ",".join(f"+{feature}" for feature in FEATURES)
os.environ |= {
    "NUMBA_CPU_NAME": LEVEL,
    "NUMBA_CPU_FEATURES": SWITCHES,
}  # read by Numba at import

import llvmlite.binding as llvm  # noqa: E402

from hopdata.code_cache import made_with  # noqa: E402
from hopdata.hybrid.driver import loop  # noqa: E402
from hopdata.hybrid.lanes import batch  # noqa: E402
from hopdata.hybrid.methods import method, table  # noqa: E402
from hopdata.hybrid.numbers import library  # noqa: E402
from hopdata.seal import sealed  # noqa: E402


def main() -> None:
    """Write a file for each function."""
    target = llvm.Target.from_default_triple()
    if not target.triple.startswith("x86_64"):
        print(
            "the wheel is built without machine code: "
            f"it is for x86_64, this is {target.triple}"
        )
        return
    folder = Path(sys.argv[1])
    folder.mkdir(parents=True)

    def keep(
        function: Callable[..., Any], digest: str, compile_it: Callable[[bool], Any]
    ) -> Any:
        """Compile as `compiled_in_cache` would; write the machine code to a file."""
        compiled = compile_it(False)
        needed = re.findall(
            r"^declare .*?@(\w+)\(", compiled.inspect_llvm(), re.MULTILINE
        )
        line = json.dumps([made_with(), compiled.native_name, FEATURES, needed])
        code = compiled._library._get_compiled_object()
        file = folder / f"{function.__name__}-{digest}"
        with sealed(file):
            file.write_bytes(line.encode() + b"\n" + code)
        return compiled

    for module in (loop, method, batch, library):
        module.compiled_in_cache = keep  # type: ignore[attr-defined]
    loop.compiled_run()
    loop.compiled_first_order()
    batch.compiled_loop()
    for names in library.GROUPS.values():
        library.place_of(names[0])
    for name in table.TABLEAUS:
        for tangents in (False, True):
            table.generic_code(name, tangents)
    for file in sorted(folder.iterdir()):
        print(f"{file.name}: {file.stat().st_size} bytes")


if __name__ == "__main__":
    main()
