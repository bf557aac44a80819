"""Compiled code, kept on disk and loaded into memory: what was compiled once for this machine never is again.

Each piece is an object file of its own, named for a digest of all that it depends on: the sources of its module and of
those that this one imports, the kinds of its arguments, the compiler's versions, the processor. The folder is
`NUMBA_CACHE_DIR`, or `cape` in the user's cache; where there is none to write to, one of this user's beside temporary
files; and where nothing can be kept, or others may write to it, pieces live in memory alone. A piece that is not whole,
or not this user's, is made anew.
"""

import contextlib
import hashlib
import importlib.metadata
import json
import logging
import os
import re
import stat
import sys
import tempfile
import threading
from collections.abc import Iterable, Sequence
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

import llvmlite.binding as llvm

from cape.kernels.jit import COMPILER_OFF, Function
from cape.kernels.packing import Kind

log = logging.getLogger("cape.compiling")

ROOT = Path(__file__).parents[2]
_IMPORT = re.compile(r"^(?:from|import) ((?:cape|skeleton)[\w.]*)(?: import (?:\(([^)]*)\)|([\w ,]*)))?", re.MULTILINE)
_SETTINGS = ("NUMBA_CPU_NAME", "NUMBA_CPU_FEATURES", "NUMBA_OPT", "NUMBA_LOOP_VECTORIZE", "NUMBA_SLP_VECTORIZE")


class Code(NamedTuple):
    """Machine code in memory: its address, and what it returns, "none" or the names of numbers."""

    address: int
    returns: str | tuple[str, ...]


class Request(NamedTuple):
    """A function for arguments of some kinds, or, `spread`, for the fields of one group of them."""

    function: Function
    kinds: tuple[Kind, ...]
    spread: bool = False

    @property
    def name(self) -> str:
        """What to call it where people read it."""
        formula = self.function.formula
        return self.function.__name__ + ("" if formula is None else f" of {formula.__module__.rpartition('.')[2]}")

    @property
    def file(self) -> str:
        """Name of its object file."""
        words = (
            self.function.place,
            _bytecode(self.function),
            self.kinds,
            self.spread,
            sources_of(self.function),
            *machine(),
        )
        return f"{self.function.__name__}-{hashlib.sha256(repr(words).encode()).hexdigest()[:32]}.o"


def _bytecode(function: Function) -> tuple[str, ...]:
    """What tells functions of one name apart that were made in one place, and their formulas."""
    code = function.python.__code__
    constants = [constant for constant in code.co_consts if not hasattr(constant, "co_code")]
    own = (code.co_code.hex(), repr(code.co_names), repr(constants))
    return own if function.formula is None else (*own, *_bytecode(function.formula))


class Piece(NamedTuple):
    """An object file with the symbol of its function and what that returns."""

    symbol: str
    returns: str | tuple[str, ...]
    data: bytes

    def pack(self) -> bytes:
        """A digest of what follows, a line of JSON, the object."""
        text = json.dumps([self.symbol, self.returns]).encode() + b"\n" + self.data
        return hashlib.sha256(text).hexdigest().encode() + b"\n" + text

    @classmethod
    def unpack(cls, text: bytes) -> "Piece":
        """The opposite of `pack`.

        Raises:
            ValueError: it is not what `pack` gave, to the last byte.
        """
        digest, _, text = text.partition(b"\n")
        if digest != hashlib.sha256(text).hexdigest().encode():
            raise ValueError("compiled code is not whole")
        head, _, data = text.partition(b"\n")
        symbol, returns = json.loads(head)
        return cls(symbol, tuple(returns) if isinstance(returns, list) else returns, data)


@cache
def machine() -> tuple[str, ...]:
    """Processor, versions and settings that compiled code depends on."""
    versions = (f"{name} {importlib.metadata.version(name)}" for name in ("numba", "llvmlite"))
    return (
        sys.version,
        *versions,
        llvm.get_default_triple(),
        llvm.get_host_cpu_name(),
        llvm.get_host_cpu_features().flatten(),
        *(os.environ.get(name, "") for name in _SETTINGS),
    )


def sources_of(function: Function) -> str:
    """Digest of the sources that a function is made of: its module, all that this imports, and the compiler's own."""
    modules = {function.__module__, "cape.kernels.packing", "cape.kernels.jit", *_compilers(ROOT)}
    while function.formula is not None:
        function = function.formula
        modules.add(function.__module__)
    return _digest(tuple(sorted(modules)))


@cache
def _compilers(root: Path) -> frozenset[str]:
    """The modules of the compiler, which are imported where something must be compiled only."""
    return frozenset(f"cape.kernels.compiler.{file.stem}" for file in (root / "cape/kernels/compiler").glob("*.py"))


@cache
def _digest(modules: tuple[str, ...]) -> str:
    known: dict[str, bytes] = {}
    waiting = list(modules)
    while waiting:
        module = waiting.pop()
        if module in known:
            continue
        path = _file_of(module)
        text = known[module] = b"" if path is None else path.read_bytes()
        if module in modules or module.startswith("cape.kernels") or not module.startswith("cape"):
            waiting += _imported(text.decode())
    digest = hashlib.sha256()
    for module in sorted(known):
        digest.update(module.encode() + b"\0" + known[module] + b"\0")
    return digest.hexdigest()


def _imported(text: str) -> Iterable[str]:
    for module, several, one in _IMPORT.findall(text):
        yield module
        for name in re.findall(r"\w+", several or one):
            if _file_of(f"{module}.{name}") is not None:
                yield f"{module}.{name}"


@cache
def _file_of(module: str) -> Path | None:
    place = ROOT.joinpath(*module.split("."))
    for path in (place.with_suffix(".py"), place / "__init__.py"):
        if path.exists():
            return path
    loaded = getattr(sys.modules.get(module), "__file__", None)
    return None if loaded is None else Path(loaded)


# -- on disk --


@cache
def folder() -> Path | None:
    """Where pieces are kept; None where nothing can be. That it is not where it should be is said once."""
    asked = os.environ.get("NUMBA_CACHE_DIR")
    named = asked or os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache")
    place = Path(named) / "cape"
    reason = "there is no home folder" if named.startswith("~") else _why_not(place)
    if reason is None:
        return place
    if not asked and hasattr(os, "getuid"):
        instead = Path(tempfile.gettempdir(), f"cape-{os.getuid()}")
        if not instead.is_symlink() and _why_not(instead) is None:
            log.warning("compiled code can't be kept in %s (%s): it is kept in %s", place, reason, instead)
            return instead
    _tell_that_nothing_is_kept(place, reason)
    return None


def _why_not(place: Path) -> str | None:
    """Why nothing can be kept in a folder, None where it can; made if it is not there."""
    try:
        place.mkdir(mode=0o700, parents=True, exist_ok=True)
        if (risk := _risk_of(place)) is not None:
            return risk
        with tempfile.TemporaryFile(dir=place):
            return None
    except OSError as error:
        return error.strerror or str(error)


def _risk_of(place: Path) -> str | None:
    """Why somebody else might put code into a folder, which this user would then run; None where nobody can."""
    if not hasattr(os, "getuid"):
        return None
    found = place.stat()
    if found.st_uid != os.getuid():
        return "it belongs to somebody else"
    # Where the sticky bit is set others may add files, which are not theirs to pass for this user's (`find`).
    if found.st_mode & (stat.S_IWGRP | stat.S_IWOTH) and not found.st_mode & stat.S_ISVTX:
        return "others can write to it"
    return None


def _is_own(file: int) -> bool:
    """Tell whether an open file is this user's."""
    return not hasattr(os, "getuid") or os.fstat(file).st_uid == os.getuid()


@cache
def _tell_that_nothing_is_kept(place: Path, reason: str | None) -> None:
    log.warning("compiled code can't be kept in %s (%s): it is compiled anew in each run", place, reason)


def find(request: Request) -> Piece | None:
    """A piece that is on disk, whole and this user's own; another is thrown away."""
    place = folder()
    if place is None:
        return None
    path = place / request.file
    try:
        with path.open("rb") as file:
            if not _is_own(file.fileno()):
                raise ValueError("compiled code is somebody else's")
            return Piece.unpack(file.read())
    except (OSError, ValueError, TypeError):
        with contextlib.suppress(OSError):
            path.unlink(missing_ok=True)
        return None


def keep(request: Request, piece: Piece) -> bool:
    """Write a piece to the disk, whole or not at all; tell whether it is there."""
    place = folder()
    if place is None:
        return False
    path = place / request.file
    unfinished = path.with_name(f"{path.name}.{os.getpid()}.{threading.get_ident()}")
    try:
        unfinished.write_bytes(piece.pack())
        unfinished.replace(path)
    except OSError as error:
        _tell_that_nothing_is_kept(place, error.strerror)
        with contextlib.suppress(OSError):
            unfinished.unlink()
        return False
    return True


# -- in memory --

_loaded: dict[Request, Code] = {}
_pieces: dict[Request, Piece] = {}  # compiled, but neither loaded nor kept on disk
_keepers: list[Any] = []
_lock = threading.RLock()
compiled: list[str] = []
"""Names of what this process has had compiled, in order."""


def code_of(request: Request) -> Code:
    """The code of a request, loaded, compiled if need be."""
    code = _loaded.get(request)
    if code is None:
        with _lock:
            code = _loaded.get(request)
            if code is None:
                prepare([request])
                piece = find(request) or _pieces.pop(request, None) or compile_here(request)
                code = _loaded[request] = _load(piece)
    return code


def compile_here(request: Request) -> Piece:
    """Compile a request in this process, and keep it."""
    from cape.kernels import compiler

    piece = Piece(*compiler.machine_code(request.function, request.kinds, spread=request.spread))
    compiled.append(request.name)
    keep(request, piece)
    return piece


def make(request: Request) -> None:
    """Compile a request, to be loaded by whoever asks for it."""
    piece = compile_here(request)
    if not is_ready(request):
        _pieces[request] = piece


def is_ready(request: Request) -> bool:
    """Tell whether a request needs no compiling."""
    if request in _loaded or request in _pieces:
        return True
    place = folder()
    return place is not None and (place / request.file).exists()


def missing(requests: Sequence[Request]) -> list[Request]:
    """Those that must be compiled, each once."""
    return [request for request in dict.fromkeys(requests) if not is_ready(request)]


@cache
def _engine() -> Any:
    llvm.initialize_native_target()
    llvm.initialize_native_asmprinter()
    return llvm.create_lljit_compiler()


def _load(piece: Piece) -> Code:
    builder = llvm.JITLibraryBuilder().add_object_img(piece.data).add_current_process().export_symbol(piece.symbol)
    library = builder.link(_engine(), f"piece{len(_keepers)}")
    _keepers.append(library)
    return Code(library[piece.symbol], piece.returns)


# -- ahead --


def prepare(requests: Sequence[Request]) -> None:
    """Have all of some requests compiled, those that are missing on all cores at once."""
    todo = [] if COMPILER_OFF else missing(requests)
    if not todo:
        return
    from cape.kernels import compiling

    compiling.compile_all(todo)


def load(requests: Sequence[Request]) -> None:
    """Have all of some requests compiled and in memory."""
    prepare(requests)
    if not COMPILER_OFF:
        for request in requests:
            code_of(request)
