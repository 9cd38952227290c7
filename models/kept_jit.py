"""Programs that are kept on disk as they were compiled: the next process neither traces nor lowers them."""

import functools
import pickle
import re
import threading
import weakref
from collections.abc import Callable, Hashable
from typing import Any

import jax
import numpy as np
from jax.core import Tracer

from gonio.models.compiled import kept
from gonio.models.fingerprint import ROOTS, Unknown, fingerprint, surroundings

MOST = 512
"""Programs of one function that a process has at hand."""
MISSING: Any = object()
_config: Any = jax.config
_every: "weakref.WeakSet[KeptJit]" = weakref.WeakSet()


def forget_programs() -> None:
    """Let go of all programs at hand, of every function; those on disk stay there."""
    for function in list(_every):
        function.programs.clear()


class KeptJit:
    """A function whose programs are kept: `eqx.filter_jit`'s rules, positional arguments only.

    Arrays are traced, all else is static. Programs are kept where JAX is told to keep its own, for arguments whose
    names another process would know (`fingerprint`); all others go to the function as it was compiled otherwise.
    """

    def __init__(
        self, function: Callable[..., Any], otherwise: Callable[..., Any], of: tuple, options: Callable[[], dict]
    ) -> None:
        functools.update_wrapper(self, function)
        self.function, self.otherwise, self.of, self.options = function, otherwise, of, options
        self.name = f"{function.__module__}.{function.__qualname__}"
        self.programs: dict[tuple, Callable[[list[Any]], Any] | None] = {}
        self.lock = threading.RLock()
        _every.add(self)

    def __call__(self, *args: Any) -> Any:
        leaves, tree = jax.tree.flatten(args)
        arrays: list[Any] = []
        kinds: list[Hashable] = [tree, *_settings()]
        for v in leaves:
            if isinstance(v, jax.Array):
                if isinstance(v, Tracer):
                    return self.otherwise(*args)
                kinds += (v.shape, v.dtype, getattr(v, "weak_type", False))
                arrays.append(v)
            elif isinstance(v, np.ndarray | np.generic):
                kinds += (v.shape, v.dtype)
                arrays.append(v)
            else:
                kinds += (type(v), v)
        key = tuple(kinds)
        try:
            program = self.programs.get(key, MISSING)
        except TypeError:  # something without a hash
            return self.otherwise(*args)
        if program is MISSING:
            program = self._made(key, args)
        return self.otherwise(*args) if program is None else program(arrays)

    def _made(self, key: tuple, args: tuple) -> Any:
        if not _keeping():
            return None
        with self.lock:
            if key not in self.programs:
                while len(self.programs) >= MOST:
                    self.programs.pop(next(iter(self.programs)))
                self.programs[key] = self._program(args)
            return self.programs[key]

    def _program(self, args: tuple) -> "_Program | None":
        """What runs for arguments of this kind, from disk or compiled now; None where it cannot be kept."""
        if self.function.__module__.partition(".")[0] not in ROOTS:
            return None
        arrays = [v for v in jax.tree.leaves(args) if isinstance(v, _ARRAYS)]
        try:
            name = kept.key(
                "xla",
                surroundings(),
                self.name,
                fingerprint(self.of),
                fingerprint(args, {id(v) for v in arrays}),
                repr(sorted(self.options().items())),
                repr(_settings()),
            )
        except Unknown:
            return None
        data = kept.read(name)
        program = None if data is None else _loaded(data)
        if program is None:
            return self._compiled(args, arrays, name)
        program.otherwise = lambda: self._compiled(args, arrays, name)
        return program

    def _compiled(self, args: tuple, arrays: list[Any], name: str) -> "_Program | None":
        out: list[Any] = []
        leaves, arguments = jax.tree.flatten(args)
        places = [k for k, v in enumerate(leaves) if isinstance(v, _ARRAYS)]

        def flat(*values: Any) -> list[Any]:
            filled = list(leaves)
            for k, v in zip(places, values, strict=True):
                filled[k] = v
            result = self.function(*jax.tree.unflatten(arguments, filled))
            results, tree = jax.tree.flatten(result)
            if not all(isinstance(v, _ARRAYS) for v in results):
                raise Unknown("a result that is not an array")
            out[:] = [jax.tree.unflatten(tree, range(len(results))), len(results)]
            return results

        # A program that JAX has kept itself cannot be written again, so each release has names of its own.
        flat.__name__ = f"{self.function.__name__}_{name[:16]}"
        try:
            lowered = jax.jit(flat, compiler_options=self.options() or None).lower(*arrays)
        except Unknown:
            return None
        calls = set(re.findall(r"custom_call @([\w.$]+)", lowered.as_text()))
        if not all(c.startswith("lapack_") for c in calls):
            return None
        with _Hits() as hits:
            compiled = lowered.compile()
        program = _Program(compiled, jax.tree.structure(out[0]))
        if hits.count:
            return program
        try:
            from jax.experimental.serialize_executable import serialize

            payload, _, _ = serialize(compiled)
            kept.write(name, pickle.dumps((payload, len(arrays), out[0], bool(calls))))
        except Exception:  # kept for speed only: what cannot be written is made again
            return program
        return program


class _Program:
    """An executable on a list of arrays, and the form of its results."""

    def __init__(self, compiled: Any, tree: Any) -> None:
        self.compiled, self.tree = compiled, tree
        self.otherwise: Callable[[], Any] | None = None

    def __call__(self, arrays: list[Any]) -> Any:
        if self.otherwise is None:
            return jax.tree.unflatten(self.tree, self.compiled(*arrays))
        return self._first(arrays, self.otherwise)

    def _first(self, arrays: list[Any], otherwise: Callable[[], Any]) -> Any:
        """The first call of what was on disk: what does not run is made again."""
        try:
            results = jax.block_until_ready(self.compiled(*arrays))
        except jax.errors.JaxRuntimeError:
            made = otherwise()
            if made is None:
                raise
            self.compiled = made.compiled
            results = self.compiled(*arrays)
        self.otherwise = None
        return jax.tree.unflatten(self.tree, results)


class _Hits:
    """Counts the programs that JAX itself takes from disk meanwhile, in this thread."""

    def __enter__(self) -> "_Hits":
        self.count, self.thread = 0, threading.get_ident()
        jax.monitoring.register_event_listener(self._listen)
        return self

    def _listen(self, event: str, **details: Any) -> None:
        self.count += event == "/jax/compilation_cache/cache_hits" and threading.get_ident() == self.thread

    def __exit__(self, *why: Any) -> None:
        jax.monitoring.unregister_event_listener(self._listen)


def _loaded(data: bytes) -> _Program | None:
    try:
        from jax.experimental.serialize_executable import deserialize_and_load

        payload, count, out, linear_algebra = pickle.loads(data)
        if linear_algebra:
            # Its functions have no addresses before something is lowered to them: a call would end the process.
            from jaxlib import lapack

            lapack.prepare_lapack_call("potrf_ffi", np.dtype(float))
        results = jax.tree.structure([0] * len(jax.tree.leaves(out)))
        compiled = deserialize_and_load(payload, jax.tree.structure(((0,) * count, {})), results)
        return _Program(compiled, jax.tree.structure(out))
    except Exception:  # of another release, or damaged: it is made again
        return None


_ARRAYS = (jax.Array, np.ndarray, np.generic)


def _keeping() -> bool:
    return bool(
        kept.keeping() and not _config.jax_disable_jit and not _config.jax_debug_nans and jax.default_backend() == "cpu"
    )


def _settings() -> tuple[Hashable, ...]:
    """What a program depends on and may change in a process."""
    return _config.jax_enable_x64, _config.read("jax_disable_most_optimizations")


def kept_jit(function: Callable[..., Any], *of: Any, options: Callable[[], dict] = dict) -> KeptJit:
    """`eqx.filter_jit` whose programs are kept; positional arguments only.

    Args:
        function: of PyTrees; its results are arrays. What is no function of a module goes by what it closes over.
        of: all that the function closes over.
        options: gives XLA's options.
    """
    import equinox as eqx

    jit: Any = eqx.filter_jit
    otherwise = functools.cache(lambda: jit(function, compiler_options=options()) if options() else jit(function))
    return KeptJit(function, lambda *args: otherwise()(*args), of, options)
