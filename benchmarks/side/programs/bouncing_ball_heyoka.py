# ruff: noqa: ARG001, D100 (a program as a user writes it)
import heyoka as hy


def bounce(integrator, sign):
    integrator.state[1] = -0.8 * integrator.state[1]
    return True


z, v = hy.make_vars("z", "v")
floor = hy.t_event(z, callback=bounce, direction=hy.event_direction.negative)
ball = hy.taylor_adaptive(
    [(z, v), (v, hy.expression(-9.8))], [50.0, 0.0], tol=1e-9, t_events=[floor]
)
ball.propagate_until(25.0)
print(*ball.state)
