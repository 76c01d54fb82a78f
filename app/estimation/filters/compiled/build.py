"""Compile a kernel to machine code, in a process that ends: `python -m app.estimation.filters.compiled.build WHAT ...`.

The object file goes to standard output. It needs numba; who runs the kernel does not, see `native`.
"""

from __future__ import annotations

import sys
from typing import Final

import llvmlite.binding as llvm
from numba import cfunc, types

from app.estimation.filters.compiled.native import ENTRY, LIBRARY_CALLS, target_machine
from app.estimation.filters.compiled.shape import Shape
from app.estimation.filters.compiled.step import make_kernels

# mypy: disable-error-code="no-untyped-call"

_NUMBERS = types.CPointer(types.float64)
SIGNATURES: Final = {
    "step": types.void(_NUMBERS, _NUMBERS),
    "record": types.void(_NUMBERS, _NUMBERS, types.int64, *[_NUMBERS] * 5),
}


def build(what: str, shape: Shape) -> bytes:
    """Return the object file of a step or a record.

    Raises:
        RuntimeError: the machine code would call something that `native` does not offer.
    """
    function = dict(zip(SIGNATURES, make_kernels(shape), strict=True))[what]
    compiled = cfunc(SIGNATURES[what], error_model="numpy")(function)
    module = llvm.parse_assembly(compiled.inspect_llvm())
    for each in module.functions:
        if each.name == compiled.native_name:
            each.name = ENTRY
        elif not each.is_declaration:
            each.linkage = "internal"
    for each in module.global_variables:
        if not each.is_declaration:
            each.linkage = "internal"
    machine = target_machine()
    options = llvm.create_pipeline_tuning_options(speed_level=3)
    builder = llvm.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    outside = {each.name for each in module.functions if each.is_declaration and not each.name.startswith("llvm.")}
    outside |= {each.name for each in module.global_variables if each.is_declaration}
    if not outside <= LIBRARY_CALLS:
        raise RuntimeError(f"the kernel calls {', '.join(sorted(outside - LIBRARY_CALLS))}")
    return bytes(machine.emit_object(module))


if __name__ == "__main__":
    n_cells, n_rc, n_temperatures, *claims = map(int, sys.argv[2:])
    sys.stdout.buffer.write(build(sys.argv[1], Shape(n_cells, n_rc, n_temperatures, *map(bool, claims))))
