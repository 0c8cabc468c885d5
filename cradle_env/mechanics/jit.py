"""How kernels are compiled: without the interpreter lock, cached on disk, and each of them once.

numba's cache looks at the file of the cached kernel alone and misses an edit in a kernel that it calls. The cache
folder is therefore named by a hash of all kernel sources, and only the kernels that Python calls are cached:
they carry everything below them.

numba optimises every kernel by itself, emits its machine code, and does so again with everything below it in each
kernel above. Here the kernels that Python calls do that alone, once for all below them: half the time of a first call.
"""

import functools
import gc
import hashlib
import logging
import os
import tempfile
import threading
from pathlib import Path

import numba
from llvmlite.binding import Linkage, create_pass_builder, create_pipeline_tuning_options
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler

# The numpy error model drops a branch per division. Kernels allocate nothing, and without numba's runtime no array is
# counted at every call: nearly twice as fast. No rewrites: they serve expressions of whole arrays. No fastmath, not
# even contracted multiply-adds: they gain 5 to 10 %, but round as the compiler happens to inline, so that the process
# that compiles differed in last bits from those that load.
_OPTIONS = {"nogil": True, "error_model": "numpy", "_nrt": False, "no_rewrites": True}
_INNER = {"no_cpython_wrapper": True, "no_cfunc_wrapper": True}
# Passes of numba for what kernels do not have: closures, functions to copy in, branches known when they compile.
_NEEDLESS = {"inline_closure_likes", "inline_inlinables", "inline_overloads", "dead_branch_prune"}


def _cache_folder() -> str | None:
    """The first writable place for compiled kernels of exactly these sources; None where there is none."""
    here = Path(__file__).parent
    digest = hashlib.sha256()
    for source in sorted(here.glob("*.py")):
        digest.update(source.read_bytes())
    name = f"kernels-{digest.hexdigest()[:16]}"
    # Where nobody knows a home, "~" is a folder like any other, and not writable either.
    user = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")) / "cradle_env"
    for parent in (here / "__pycache__", user):
        try:
            folder = parent / name
            folder.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryFile(dir=folder):
                return str(folder)
        except OSError:
            continue
    return None


_FOLDER = _cache_folder()


class _WholeCode(JITCodeLibrary):
    """Code of a kernel that Python calls, with that of all kernels below it."""

    def add_linking_library(self, library):
        """Takes in the code of a kernel, and what that calls: last, for LLVM links only what is called already."""
        for other in (library, *library._linking_libraries):
            if other in self._linking_libraries:
                self._linking_libraries.remove(other)
            super().add_linking_library(other)

    def _optimize_functions(self, module):
        # numba lets its passes run on declarations too, which are most of what a small kernel's module has.
        module.data_layout = self._codegen._data_layout
        passes = create_pass_builder(self._codegen._tm, create_pipeline_tuning_options(speed_level=3))
        simplify = passes.getFunctionPassManager()
        for function in module.functions:
            if not function.is_declaration:
                simplify.run(function, passes)

    def _optimize_final_module(self):
        # Nobody else calls a kernel below: where one caller is all that it has, it becomes a part of that.
        for function in self._final_module.functions:
            if not function.is_declaration and function.linkage == Linkage.linkonce_odr:
                function.linkage = Linkage.internal
        super()._optimize_final_module()


class _Code(_WholeCode):
    """Code of a kernel that other kernels call, to be optimised in these: it has no address of its own."""

    def finalize(self):
        """Leaves the code as it is."""
        self._finalized = True

    def get_pointer_to_function(self, name):
        """No address."""
        return 0

    @property
    def codegen(self):
        """What is told of the address of Python's environment for the kernel, which has none either."""
        return self

    def set_env(self, name, environment):
        """Takes no environment: kernels raise no exceptions."""


class _Inner(Compiler):
    """Compiles a kernel that other kernels call."""

    code = _Code

    def define_pipelines(self):
        """numba's own passes, as far as kernels need them, into a library of ours."""
        self.state.library = self.code(self.state.targetctx.codegen(), "kernel")
        self.state.library.enable_object_caching()
        pipelines = super().define_pipelines()
        for pipeline in pipelines:
            pipeline.passes = [each for each in pipeline.passes if each[0].name() not in _NEEDLESS]
        return pipelines


class _Entry(_Inner):
    """Compiles a kernel that Python calls, and all below it."""

    code = _WholeCode

    def compile_extra(self, func):
        """Compiles without the search for garbage, which takes a fifth of the time and finds little."""
        if not gc.isenabled():
            return super().compile_extra(func)
        gc.disable()
        try:
            return super().compile_extra(func)
        finally:
            gc.enable()


class _Extra(_Entry):
    """Compiles a kernel for what most runs do not need."""

    def compile_extra(self, func):
        """Says so, for it takes seconds."""
        message = "compiling %r, which most runs do not need: once for this machine"
        logging.getLogger("cradle_env").warning(message, func.__name__)
        return super().compile_extra(func)


def jit(function):
    """Compiles a kernel that other kernels call."""
    return numba.njit(pipeline_class=_Inner, **_OPTIONS, **_INNER)(function)


def leaf(function):
    """Compiles a small kernel whose machine code goes into each of its callers."""
    return numba.njit(forceinline=True, pipeline_class=_Inner, **_OPTIONS, **_INNER)(function)


def entry(function):
    """Compiles a kernel that Python calls, and caches it."""
    return _cached(function, _Entry, {})


def extra(function):
    """Compiles a kernel for what most runs do not need, says so, and caches it. Only `apart` calls it."""
    return _cached(function, _Extra, _INNER)


def _cached(function, pipeline, options):
    if _FOLDER is None:
        return numba.njit(pipeline_class=pipeline, **_OPTIONS, **options)(function)
    previous, numba.config.CACHE_DIR = numba.config.CACHE_DIR, _FOLDER
    try:
        return numba.njit(cache=True, pipeline_class=pipeline, **_OPTIONS, **options)(function)
    finally:
        numba.config.CACHE_DIR = previous


def once(function):
    """Keeps what a function returns; threads that ask for it at the same time wait for the first of them."""
    kept, lock = functools.cache(function), threading.Lock()

    @functools.wraps(function)
    def waiting(*arguments):
        with lock:
            return kept(*arguments)

    return waiting
