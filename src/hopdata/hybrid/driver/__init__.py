"""The loop shared by all integrations: step, localise, land, flip, continue.

- `loop`: the integration, and Python's entry into it
- `stepping`: one step that meets the tolerance; the size and the method of the next
- `branches`, `windows`: shorten it to a part in which the guards can be judged
- `watch`, `localise`: which guards may flip in it, and where the first one does
- `end_step`: make the step end there
- `instant`: the events there, one after the other
- `jacobian`: the flow's Jacobian over a step and across an event
- `dense`, `log`: what is written of the trajectory and of the events
- `sleep`: guards that cannot flip for a while
- `problem`: what is integrated, and what counts as rounding
"""
