"""Machine code of this processor from LLVM's language, kept on disk."""

import ctypes
import functools
import threading
from typing import Any, NamedTuple

from gonio.models.compiled import kept

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

    def __init__(self, text: str) -> None:
        import llvmlite.binding as llvm

        made = machine()
        assert made is not None
        key = kept.key(made.name, text)
        with LOCK:
            binary = kept.read(key)
            if binary is None:
                binary = _compiled(llvm, made, text)
                kept.write(key, binary)
            # In one piece of memory: code reaches constants within 2 GiB alone, and LLVM ends the process otherwise.
            self._engine = llvm.create_mcjit_compiler(llvm.parse_assembly(""), _engine_target(llvm), use_lmm=True)
            self._engine.add_object_file(llvm.ObjectFileRef.from_data(binary))
            self._engine.finalize_object()
            address = self._engine.get_function_address("kernel")
        pointer, size = ctypes.c_void_p, ctypes.c_int64
        self.call = ctypes.CFUNCTYPE(ctypes.c_int32, pointer, pointer, pointer, size, size, pointer)(address)


def _engine_target(llvm: Any) -> Any:
    """A machine for one engine, which takes it over."""
    return llvm.Target.from_triple(llvm.get_process_triple()).create_target_machine(jit=True)


def _compiled(llvm: Any, made: Machine, text: str) -> bytes:
    module = llvm.parse_assembly(text)
    module.triple = made.target.triple
    module.data_layout = str(made.target.target_data)
    return made.target.emit_object(module)
