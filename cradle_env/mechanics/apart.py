"""Kernels that are compiled apart from those that call them, when they are first called.

Most runs need no bobs in lasting contact, no rigid strings and no effects. A kernel for such things is reached by its
address, which the calling kernel asks for once: Python compiles it then, or loads it from the cache.
"""

import contextlib
import ctypes
import functools
import os
import sys
import threading
from _thread import interrupt_main

import llvmlite.binding
import numba
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.extending import intrinsic

from cradle_env.mechanics.jit import extra
from cradle_env.mechanics.layout import BOB, CRADLE

#: Types of what such kernels take: a cradle, its bobs, an array such as S or W.
CRADLE_TYPE = numba.from_dtype(CRADLE)
BOBS_TYPE = types.Array(numba.from_dtype(BOB), 1, "C")
ROWS_TYPE = types.Array(types.float64, 2, "C")
#: The first arguments of most: cradle, bobs, S, W, lo, hi.
GROUP = (CRADLE_TYPE, BOBS_TYPE, ROWS_TYPE, ROWS_TYPE, types.int64, types.int64)

_ADDRESS = ir.IntType(8).as_pointer()
_FINDER = ctypes.CFUNCTYPE(ctypes.c_void_p)
# Functions that machine code calls, which must live as long as the process.
_finders = []


def apart(result, *arguments):
    """Compiles apart a kernel that gives `result` from `arguments`, types of numba. Kernels call it as any other."""

    def decorate(function):
        kernel, name = extra(function), f"cradle_env.{function.__module__}.{function.__name__}"
        find = functools.partial(_address, kernel, arguments)
        _finders.append(_FINDER(functools.partial(_uninterrupted, find)))
        llvmlite.binding.add_symbol(name, ctypes.cast(_finders[-1], ctypes.c_void_p).value)

        @intrinsic
        def call(typing, *given):
            def codegen(context, builder, signature, values):
                values = cgutils.unpack_tuple(builder, values[0])
                cast = [context.cast(builder, *each) for each in zip(values, given, arguments, strict=True)]
                kind = context.call_conv.get_function_type(result, arguments).as_pointer()
                address = builder.bitcast(_found(builder, name), kind)
                return context.call_conv.call_function(builder, address, result, arguments, cast)[1]

            return result(types.StarArgTuple(given)), codegen

        return call

    return decorate


def compile_all():
    """Compiles all such kernels, or loads them where that has been done."""
    for find in _finders:
        find()


def _found(builder, name):
    """The address of the kernel of this name: Python is asked for it once for each calling module."""
    module, cell = builder.module, f"{name}.address"
    if cell not in module.globals:
        variable = cgutils.add_global_variable(module, _ADDRESS, cell)
        variable.linkage, variable.initializer = "internal", ir.Constant(_ADDRESS, None)
    known = module.globals[cell]
    with builder.if_then(cgutils.is_null(builder, builder.load(known)), likely=False):
        finder = cgutils.get_or_insert_function(module, ir.FunctionType(_ADDRESS, []), name)
        builder.store(builder.call(finder, []), known)
    return builder.load(known)


def _address(kernel, arguments):
    """Where the machine code of a kernel begins."""
    with contextlib.suppress(OSError):  # of the cache, where a disk is full: the code is there all the same
        kernel.compile(arguments)
    compiled = kernel.overloads[arguments]
    return compiled.library.get_pointer_to_function(compiled.fndesc.llvm_func_name)


def _uninterrupted(function):
    """What `function` returns. Machine code waits for it, so Ctrl-C must: the function runs in a thread, which gets
    none, and the main thread is interrupted afterwards.

    Machine code cannot take an exception, and without an address it cannot go on: after an error the process ends.
    """
    found, interrupted = [], False
    thread = threading.Thread(target=lambda: found.append(function()))
    thread.start()
    while thread.is_alive():
        try:
            thread.join()
        except KeyboardInterrupt:
            interrupted = True
    if interrupted:
        interrupt_main()
    if not found:
        print("cradle_env: a kernel could not be compiled (see above), and the run cannot go on.", file=sys.stderr)
        sys.stderr.flush()
        os.abort()
    return found[0]
