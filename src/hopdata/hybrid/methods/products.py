"""Products of the blocks of a tangent's table: in vector instructions where they are small."""

from __future__ import annotations

from typing import Any

from hopdata.hybrid.compiled.blocks import add_product, multiply
from hopdata.hybrid.compiled.fused import fma
from hopdata.hybrid.compiled.views import FloatTable

N = 0  # put in for each scene

LARGEST_IN_VECTORS = 16  # columns; the code of a product grows with the cube of their number


def multiply_vectors(phi: FloatTable, target: int, left: int, right: int) -> None:
    """Write the product of two blocks, named by their first rows, into a third one."""
    multiply(phi, target, left, right, N)


def add_product_vectors(
    phi: FloatTable, target: int, base: int, left: int, right: int, factor: float
) -> None:
    """Write base + factor left right into the block `target`, which is none of them."""
    add_product(phi, target, base, left, right, factor, N)


def multiply_numbers(phi: FloatTable, target: int, left: int, right: int) -> None:
    """Write the product of two blocks, named by their first rows, into a third one."""
    for i in range(N):
        first = phi[left + i, 0]
        for j in range(N):
            phi[target + i, j] = first * phi[right, j]
        for k in range(1, N):
            one = phi[left + i, k]
            for j in range(N):
                phi[target + i, j] = fma(one, phi[right + k, j], phi[target + i, j])


def add_product_numbers(
    phi: FloatTable, target: int, base: int, left: int, right: int, factor: float
) -> None:
    """Write base + factor left right into the block `target`, which is none of them."""
    for i in range(N):
        first = phi[left + i, 0]
        for j in range(N):
            phi[target + i, j] = first * phi[right, j]
        for k in range(1, N):
            one = phi[left + i, k]
            for j in range(N):
                phi[target + i, j] = fma(one, phi[right + k, j], phi[target + i, j])
        for j in range(N):
            phi[target + i, j] = fma(factor, phi[target + i, j], phi[base + i, j])


def product_templates(n_states: int) -> dict[str, Any]:
    """Return the templates of products of matrices of this size."""
    if n_states <= LARGEST_IN_VECTORS:
        return {"MULTIPLY": multiply_vectors, "ADD_PRODUCT": add_product_vectors}
    return {"MULTIPLY": multiply_numbers, "ADD_PRODUCT": add_product_numbers}
