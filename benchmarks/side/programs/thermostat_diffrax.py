# ruff: noqa: ARG001, D100 (a program as a user writes it)
import diffrax
import jax
import jax.numpy as jnp
import optimistix

jax.config.update("jax_enable_x64", True)


def room(t, y, heating):
    return 0.1 * (15.0 - y) + heating


def cold(t, y, args, **_):
    return y[0] - 19.0


def warm(t, y, args, **_):
    return 21.0 - y[0]


def to_next_event(now):
    t, y, heating = now
    part = diffrax.diffeqsolve(
        diffrax.ODETerm(room), diffrax.Dopri8(), t, 60.0, None, y, args=heating,
        stepsize_controller=diffrax.PIDController(rtol=1e-9, atol=1e-12),
        event=diffrax.Event([cold, warm], optimistix.Newton(1e-10, 1e-10), direction=False),
        adjoint=diffrax.ForwardMode(), max_steps=10_000,
    )  # fmt: skip
    t, y = part.ts[-1], part.ys[-1]
    return t, y, jnp.where(part.event_mask[0], 1.0, 0.0)


@jax.jit
def thermostat(now):
    return jax.lax.while_loop(lambda now: now[0] < 60.0, to_next_event, now)


print(*thermostat((jnp.array(0.0), jnp.array([20.0]), jnp.array(1.0)))[1])
