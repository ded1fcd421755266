"""The dissertation's integration method (chapter IV), in plain NumPy.

It is what the text describes, for comparison and for teaching; `hopdata.hybrid.solve`
is faster and more accurate. A classical solver runs until an event function has changed
its sign between two points of its mesh. The events on that step are then resolved on
cubic Hermite splines, followed by a third-order step to its end.

- `region_of`: one event-selected region, in which each guard is crossed once;
- `integrate`: the loop around any classical solver (contribution 1.3.5);
- `Stepping`, `Ivp`, `FixedSteps`: classical solvers from SciPy's steppers, from
  `scipy.integrate.solve_ivp` and its events, and from a function that makes one step;
- `resolve_contacts`, `impact_fractions`: Algorithms 5 and 6;
- `integrate_alternating`: Algorithm 7; `integrate_both_ways`: the same for many guards;
- `states_at`: states between the mesh points, by the method's Hermite splines;
- `PrintedOptions`: the default is corrected, `AS_PRINTED` is the text to the letter;
- `hopdata.hybrid.printed.theorem`: Theorem 4.2.1 with the constants of Table 4.1;
- `hopdata.hybrid.printed.order`: the order of a method from errors at many steps.
"""

from hopdata.hybrid.printed.alternate import integrate_alternating
from hopdata.hybrid.printed.both_ways import integrate_both_ways
from hopdata.hybrid.printed.integrate import integrate
from hopdata.hybrid.printed.interpolation import states_at
from hopdata.hybrid.printed.one_step import dopri5_step, heun3_step, rk4_step
from hopdata.hybrid.printed.options import AS_PRINTED, CHOICES, PrintedOptions
from hopdata.hybrid.printed.region import Region, region_of
from hopdata.hybrid.printed.resolution import (
    Crossing,
    Resolution,
    Step,
    impact_fractions,
    resolve_contacts,
)
from hopdata.hybrid.printed.roots import closed_form, illinois, illinois_root
from hopdata.hybrid.printed.solvers import (
    ClassicalSolver,
    FixedSteps,
    Ivp,
    Mesh,
    Stepping,
    Stop,
)
from hopdata.hybrid.printed.spline import coefficients, hermite
from hopdata.hybrid.printed.trajectory import PrintedSolution

__all__ = [
    "AS_PRINTED",
    "CHOICES",
    "ClassicalSolver",
    "Crossing",
    "FixedSteps",
    "Ivp",
    "Mesh",
    "PrintedOptions",
    "PrintedSolution",
    "Region",
    "Resolution",
    "Step",
    "Stepping",
    "Stop",
    "closed_form",
    "coefficients",
    "dopri5_step",
    "hermite",
    "heun3_step",
    "illinois",
    "illinois_root",
    "impact_fractions",
    "integrate",
    "integrate_alternating",
    "integrate_both_ways",
    "region_of",
    "resolve_contacts",
    "rk4_step",
    "states_at",
]
