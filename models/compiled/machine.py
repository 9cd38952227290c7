"""Machine code of this processor from LLVM's language, kept on disk."""

import ctypes
import functools
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

from gonio.models.compiled import kept
from gonio.models.compiled.graph import Unsupported

LOCK = threading.Lock()
"""LLVM's objects are made by one thread at a time."""


class Machine(NamedTuple):
    """What code is made for: a vector's bytes, attributes of functions, a name by which code is kept, and what of
    `emission.Kernel` it has."""

    target: Any
    vector_bytes: int
    attributes: str
    name: str
    estimates: bool
    flush: bool


@functools.cache
def machine() -> Machine | None:
    """This processor, or None where code for it would be slow: without a fused multiplication and addition."""
    try:
        import llvmlite
        import llvmlite.binding as llvm

        llvm.initialize_native_target()
        llvm.initialize_native_asmprinter()
        features = llvm.get_host_cpu_features()
        triple, cpu = llvm.get_process_triple(), llvm.get_host_cpu_name()
    except (ImportError, OSError, RuntimeError):
        return None
    arm = triple.startswith(("aarch64", "arm64"))
    if not (arm or features.get("fma")):
        return None
    wide = features.get("avx512f") and features.get("avx512dq")
    size = 16 if arm else 64 if wide else 32
    width = f'"prefer-vector-width"="{size * 8}" "min-legal-vector-width"="{size * 8}"'
    target = llvm.Target.from_triple(triple).create_target_machine(
        cpu=cpu, features=features.flatten(), opt=2, reloc="pic", codemodel="default", jit=True
    )
    name = f"{llvmlite.__version__} {llvm.llvm_version_info} {triple} {cpu} {features.flatten()}"
    return Machine(target, size, f"nounwind {width}", name, bool(wide), not arm)


class Code:
    """A compiled function, which lives as long as this object."""

    def __init__(self, binary: bytes) -> None:
        """Load the object code of a function called kernel."""
        import llvmlite.binding as llvm

        with LOCK:
            # In one piece of memory: code reaches constants within 2 GiB alone, and LLVM ends the process otherwise.
            self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _engine_target(llvm), use_lmm=True)
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(binary))
            self._engine.finalize_object()
            address = self._engine.get_function_address("kernel")
        pointer, size = ctypes.c_void_p, ctypes.c_int64
        self.call = ctypes.CFUNCTYPE(ctypes.c_int32, pointer, pointer, pointer, size, size, pointer)(address)


def compiled(text: str) -> Code:
    """The function of a text in LLVM's language, compiled now or kept.

    Raises:
        Unsupported: LLVM does not take the code.
    """
    made = machine()
    assert made is not None
    return Code(_object_code(made, text_key(text), text))


def text_key(text: str) -> str:
    """The name by which the code of a text is kept."""
    made = machine()
    assert made is not None
    return kept.key(made.name, text)


def compiled_as(name: str, text: Callable[[], str]) -> Code:
    """The function of a text that has a name, and is not even written where the function is kept.

    Args:
        name: of all that the text depends on.
        text: writes it, or raises Unsupported, which is kept as well.

    Raises:
        Unsupported: there is no such text, or LLVM does not take it.
    """
    made = machine()
    if made is None:
        raise Unsupported("this processor")
    key = kept.key("named", made.name, name)
    binary = kept.read(key)
    if binary is None:
        try:
            binary = _object_code(made, key, text())
        except Unsupported:
            kept.write(key, b"")
            raise
    if not binary:
        raise Unsupported("as in an earlier process")
    return Code(binary)


def _object_code(made: Machine, key: str, text: str) -> bytes:
    import llvmlite.binding as llvm

    with LOCK:
        binary = kept.read(key)
        if binary is None:
            try:
                binary = _compiled(llvm, made, text)
            except RuntimeError as error:  # LLVM's word for code that it does not take
                raise Unsupported(str(error)) from error
            kept.write(key, binary)
        return binary


def _engine_target(llvm: Any) -> Any:
    """A machine for one engine, which takes it over."""
    return llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)


def _compiled(llvm: Any, made: Machine, text: str) -> bytes:
    module = llvm.parse_assembly(text)
    module.triple = made.target.triple
    module.data_layout = str(made.target.target_data)
    return made.target.emit_object(module)
