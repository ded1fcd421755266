# ruff: noqa: ARG001, D100 (a program as a user writes it)
import heyoka as hy


def switch(heating):
    def callback(integrator, sign):
        integrator.pars[0] = heating
        return True

    return callback


y = hy.make_vars("y")
falling = hy.event_direction.negative
cold = hy.t_event(y - 19.0, callback=switch(1.0), direction=falling)
warm = hy.t_event(21.0 - y, callback=switch(0.0), direction=falling)
thermostat = hy.taylor_adaptive(
    [(y, 0.1 * (15.0 - y) + hy.par[0])], [20.0], pars=[1.0], tol=1e-9,
    t_events=[cold, warm],
)  # fmt: skip
thermostat.propagate_until(60.0)
print(*thermostat.state)
