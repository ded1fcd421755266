"""The loop shared by all integrations: step, localise, land, flip, continue.

- `loop`: the integration, and Python's entry into it
- `known`: instants at which the field jumps: a step ends there, the next begins anew
- `stepping`: one step that meets the tolerance; the size and the method of the next
- `enclosure`, `paths`: ranges of the states and of the guards over a piece of it
- `ahead`: ranges of the guards that serve several steps
- `proof`: prove that no guard flips in it, or find the first that does
- `localise`, `end_step`: find where, and make the step end there
- `watch`: guards at their surfaces, and those that will soon reach theirs
- `instant`: the events there, one after the other
- `tangents`: the flow's Jacobian over a step
- `jacobian`: the same across an instant; `slopes`: of a guard; `resets`: of a handler
- `dense`, `log`: what is written of the trajectory and of the events
- `sleep`: guards that cannot flip for a while
- `problem`: what is integrated, and what counts as rounding
"""
