# ruff: noqa: ARG001, D100 (a program as a user writes it)
import heyoka as hy


def spike(integrator, sign):
    integrator.state[:] = -65.0, integrator.state[1] + 8.0
    return True


v, u = hy.make_vars("v", "u")
threshold = hy.t_event(v - 30.0, callback=spike, direction=hy.event_direction.positive)
rates = [(v, 0.04 * v * v + 5.0 * v + 150.0 - u), (u, 0.02 * (0.2 * v - u))]
neuron = hy.taylor_adaptive(rates, [-65.0, -13.0], tol=1e-9, t_events=[threshold])
neuron.propagate_until(200.0)
print(*neuron.state)
