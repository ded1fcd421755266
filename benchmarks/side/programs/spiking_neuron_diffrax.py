# ruff: noqa: ARG001, D100 (a program as a user writes it)
import diffrax
import jax
import jax.numpy as jnp
import optimistix

jax.config.update("jax_enable_x64", True)


def membrane(t, y, args):
    v, u = y
    return jnp.array([0.04 * v * v + 5.0 * v + 150.0 - u, 0.02 * (0.2 * v - u)])


def threshold(t, y, args, **_):
    return y[0] - 30.0


def to_next_event(now):
    t, y = now
    part = diffrax.diffeqsolve(
        diffrax.ODETerm(membrane), diffrax.Dopri8(), t, 200.0, None, y, args=None,
        stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-12),
        event=diffrax.Event(threshold, optimistix.Newton(1e-10, 1e-10), direction=True),
        adjoint=diffrax.ForwardMode(), max_steps=10_000,
    )  # fmt: skip
    t, y = part.ts[-1], part.ys[-1]
    return t, jnp.where(t < 200.0, jnp.array([-65.0, y[1] + 8.0]), y)


@jax.jit
def neuron(now):
    return jax.lax.while_loop(lambda now: now[0] < 200.0, to_next_event, now)


print(*neuron((jnp.array(0.0), jnp.array([-65.0, -13.0])))[1])
