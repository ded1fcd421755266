# ruff: noqa: ARG001, D100 (a program as a user writes it)
import diffrax
import jax
import jax.numpy as jnp
import optimistix

jax.config.update("jax_enable_x64", True)


def fall(t, y, args):
    return jnp.array([y[1], -9.8])


def floor(t, y, args, **_):
    return y[0]


def to_next_event(now):
    t, y = now
    part = diffrax.diffeqsolve(
        diffrax.ODETerm(fall), diffrax.Dopri8(), t, 25.0, None, y, args=None,
        stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-12),
        event=diffrax.Event(floor, optimistix.Newton(1e-10, 1e-10), direction=False),
        adjoint=diffrax.ForwardMode(), max_steps=10_000,
    )  # fmt: skip
    t, y = part.ts[-1], part.ys[-1]
    return t, jnp.where(t < 25.0, jnp.array([y[0], -0.8 * y[1]]), y)


@jax.jit
def ball(now):
    return jax.lax.while_loop(lambda now: now[0] < 25.0, to_next_event, now)


print(*ball((jnp.array(0.0), jnp.array([50.0, 0.0])))[1])
