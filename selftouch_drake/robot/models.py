"""From model directives to what Drake's parser takes, and every file that decides the robot."""

import contextlib
import json
import logging.handlers
import sys
import xml.dom.expatbuilder
import xml.dom.minidom
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote
from xml.parsers.expat import ExpatError

import numpy as np
from pydrake.common.yaml import yaml_dump_typed
from pydrake.multibody.parsing import (
    LoadModelDirectives,
    ModelDirectives,
    PackageMap,
    Parser,
    ProcessModelDirectives,
)
from pydrake.multibody.plant import MultibodyPlant

from selftouch_drake.experiment import ExperimentError, closest
from selftouch_drake.lazy import trimesh
from selftouch_drake.resources import MODELS
from selftouch_drake.robot.converted import as_obj, cache_folder, cached_copy
from selftouch_drake.robot.facts import ModelFacts, Parsed, apply_facts
from selftouch_drake.robot.mjcf import strip_for_drake, write_out
from selftouch_drake.robot.mjcf_facts import mjcf_facts
from selftouch_drake.robot.urdf import number_actuators, refuse_xacro, sdf_facts, urdf_facts

# The package of the shipped models, which is always there.
SHIPPED = "selftouch_drake"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotModel:
    """A robot as Drake loads it.

    Attributes:
        directives: ready for `ProcessModelDirectives`; where meshes were converted, they name
            copies of models in the cache.
        packages: absolute roots of `package://` URIs, by name.
        files: every file whose content decides the robot, as its author wrote it: directives,
            models, what they include, and meshes.
        facts: what Drake's parser leaves out, by the path at which Drake reads a model.
    """

    directives: ModelDirectives
    packages: Mapping[str, Path]
    files: tuple[Path, ...]
    facts: Mapping[str, ModelFacts]


def load_model(
    directives: str,
    packages: Mapping[str, str],
    announce: Callable[[str], None] | None = None,
) -> RobotModel:
    """Finds a robot's models, and converts meshes that Drake refuses.

    Args:
        directives: a `package://` or `file://` URI, or a path, of a file of model directives.
        packages: roots of `package://` URIs by name; `{prefix}` in a root stands for `sys.prefix`,
            where wheels put shared data.
        announce: called with one line if meshes were converted.

    Raises:
        ExperimentError: a file or a package is not found or cannot be read, or a mesh cannot be
            converted.
    """
    roots = _package_roots(packages)
    reader = _Reader(roots)
    loaded, _ = reader.directives(reader.find(directives, Path.cwd(), what="robot.directives"))
    if reader.num_converted and announce is not None:
        number = f"{reader.num_converted} mesh" + ("es" if reader.num_converted > 1 else "")
        announce(f"converted {number} to OBJ into {cache_folder() / 'meshes'}")
    return RobotModel(
        directives=loaded, packages=roots, files=tuple(reader.files), facts=reader.facts
    )


def parse(plant: MultibodyPlant, model: RobotModel) -> Parsed:
    """Adds a robot to a plant, with all that its files say.

    Returns:
        The facts of each model, for `check_facts` and `ContactRules`, and what Drake warned of.

    Raises:
        ExperimentError: a model does not parse; the text is Drake's own, in one line.
    """
    parser = Parser(plant)
    for name, root in model.packages.items():
        parser.package_map().Add(name, str(root))
    with one_line("robot.directives cannot be loaded", model.facts) as logged:
        loaded = ProcessModelDirectives(model.directives, parser)
    models = [
        (info.model_instance, model.facts[info.model_path])
        for info in loaded
        if info.model_path in model.facts
    ]
    for instance, facts in models:
        apply_facts(plant, instance, facts)
    return Parsed(models=models, logged=[record.getMessage() for record in logged])


def parse_file(plant: MultibodyPlant, file: Path) -> Parsed:
    """Adds the models of one file, as `parse` does: a model, or directives.

    Raises:
        ExperimentError: a file that it names is not found or cannot be read, or does not parse.
    """
    if file.name.endswith((".yaml", ".yml")):
        return parse(plant, load_model(str(file.resolve()), {}))
    reader = _Reader(_package_roots({}))
    place = reader.model(file.resolve())
    parser = Parser(plant)
    parser.package_map().Add(SHIPPED, str(MODELS.resolve()))
    with one_line(f"{file} cannot be loaded", reader.facts) as logged:
        instances = parser.AddModels(str(place))
    models = [(i, reader.facts[str(place)]) for i in instances[:1] if str(place) in reader.facts]
    for instance, facts in models:
        apply_facts(plant, instance, facts)
    return Parsed(models=models, logged=[record.getMessage() for record in logged])


def rewritten(file: Path) -> tuple[Path, ModelFacts]:
    """Where Drake is to read a model that is at `file`, and what its parser leaves out.

    Raises:
        ExperimentError: a file that it names is not found, or one cannot be read.
    """
    reader = _Reader(_package_roots({}))
    place = reader.model(file)
    return place, reader.facts[str(place)]


def _package_roots(packages: Mapping[str, str]) -> dict[str, Path]:
    roots = {SHIPPED: MODELS.resolve()}
    own = PackageMap()
    for name, given in packages.items():
        field = f"robot.packages.{name}"
        if name in roots or own.Contains(name):
            raise ExperimentError(f"{field} is a package that always exists; give it another name")
        root = Path(given.replace("{prefix}", sys.prefix)).expanduser().resolve()
        if not root.is_dir():
            raise ExperimentError(
                f"{field} is {given!r}, and {root} is not a folder; give the folder of the "
                "package, or install the package"
            )
        roots[name] = root
    return roots


# Folders above a model in which its packages are looked for.
_NUM_ABOVE = 4


def _likely_root(name: str, folder: Path) -> str:
    """The folder of an unknown package, if one of its name lies beside or above `folder`."""
    for above in [folder, *folder.parents][:_NUM_ABOVE]:
        for root in (above, above / name):
            if root.name == name and root.is_dir():
                return str(root)
    return "FOLDER"


class _Reader:
    """Walks from directives to meshes, and notes every file on the way.

    A model that names a mesh that Drake refuses is copied into the cache, where it names the
    converted mesh. What names a copied file is copied in its turn.
    """

    def __init__(self, roots: Mapping[str, Path]):
        self._roots, self._drake = roots, PackageMap()
        self._open: list[Path] = []
        self.files: dict[Path, None] = {}  # an ordered set
        self.facts: dict[str, ModelFacts] = {}
        self.num_converted = 0

    def find(self, uri: str, folder: Path, *, what: str) -> Path:
        """The file that `uri` names; a relative path starts at `folder`.

        Raises:
            ExperimentError: the package is unknown, or there is no such file; the text begins with
                `what`.
        """
        scheme, separator, rest = uri.partition("://")
        if not separator:
            path = folder / uri
        elif scheme == "file":
            path = Path(rest)
        elif scheme in ("package", "model"):
            name, _, inside = rest.partition("/")
            if name in self._roots:
                root = self._roots[name]
            elif self._drake.Contains(name):
                with one_line(f"{what} is {uri!r}"):  # Drake downloads what it does not hold.
                    root = Path(self._drake.GetPath(name))
            else:
                known = [*self._roots, *self._drake.GetPackageNames()]
                hint = closest(name, known) or (
                    f"known are {', '.join(known)}; give its folder, as in "
                    f"packages: {{{name}: {_likely_root(name, folder)}}}"
                )
                raise ExperimentError(
                    f"{what} is {uri!r}; there is no package {name!r} in robot.packages: {hint}"
                )
            path = root / inside
        else:
            raise ExperimentError(f"{what} is {uri!r}; give a path, or package://NAME/PATH")
        if not path.exists():
            raise ExperimentError(f"{what} is {uri!r}, and {path} does not exist; correct the path")
        return _model_in(path, what) if path.is_dir() else path.resolve()

    def directives(self, path: Path) -> tuple[ModelDirectives, bool]:
        """Directives with absolute files in them, and whether one of these is a copy."""
        any_copied = False
        if path.suffix.lower() in (".xacro", *_NAMING):
            raise ExperimentError(
                f"directives {path} are the model of a robot; write directives (.dmd.yaml) that "
                f"add it, as in directives: [{{add_model: {{name: robot, file: {path.name}}}}}], "
                "and weld what floats freely (add_weld)"
            )
        with self._reading(path):
            with one_line(f"directives {path} cannot be read"):
                loaded = LoadModelDirectives(str(path))
            for directive in loaded.directives:
                entry = directive.add_model or directive.add_directives
                if entry is None:
                    continue
                file = place = self.find(entry.file, path.parent, what=f"file in {path}")
                if directive.add_model:
                    place = self.model(file)
                else:
                    nested, copied = self.directives(file)
                    if copied:
                        place = cached_copy(file.name, yaml_dump_typed(nested))
                any_copied |= place != file
                entry.file = f"file://{place}"  # Drake does not decode what as_uri quotes
        return loaded, any_copied

    def model(self, path: Path) -> Path:
        """Reads a model file; returns where Drake is to read it, which may be a copy."""
        with self._reading(path):
            suffix = path.suffix.lower()
            if suffix not in (".xacro", *_NAMING):  # Drake says what is wrong with it.
                return path
            document = _read_xml(path)
            facts, is_changed = self._facts(document, path)
            is_changed |= self._name_files(document, path, suffix)
        place = cached_copy(path.name, document.toxml()) if is_changed else path
        self.facts[str(place)] = facts
        return place

    def _facts(self, document: Any, path: Path) -> tuple[ModelFacts, bool]:
        """What a file says that Drake leaves out, and whether the document was changed for it."""
        kind = document.documentElement.tagName
        if kind == "mujoco":
            self._join_included(document, document, path.parent)
            try:
                write_out(document, path)
                facts = mjcf_facts(document, path)
            except ExperimentError:
                raise
            except (ValueError, IndexError) as error:  # such as a number that is none
                reason = " ".join(str(error).split())[:200]
                raise ExperimentError(
                    f"{path} is not readable MJCF ({reason}); open it in MuJoCo, and correct it"
                ) from None
            strip_for_drake(document)
            return facts, True
        if kind == "sdf":
            return sdf_facts(document, path), False
        refuse_xacro(document, path)
        return urdf_facts(document, path), number_actuators(document)

    def _name_files(self, document: Any, path: Path, suffix: str) -> bool:
        """Writes where Drake is to read the files that a model names; whether one is elsewhere."""
        places = []
        is_changed = _write_hulls(document)
        for node, folder, taken in _references(document, suffix, path.parent):
            # An attribute, or the text of an element; else it names no file.
            is_text = isinstance(node, xml.dom.minidom.Attr | xml.dom.minidom.Text)
            if is_text and (uri := node.nodeValue.strip()):
                file = self.find(uri, folder, what=f"file in {path}")
                place = self._place(file, taken)
                places.append((node, place))
                is_changed |= file != place or not Path(uri).suffix  # of a folder
        if is_changed or document.documentElement.tagName == "mujoco":
            for node, place in places:
                # All of them: a relative path would start in the cache.
                node.nodeValue = str(place)
        return is_changed

    def _place(self, file: Path, taken: frozenset[str] | None) -> Path:
        """Where Drake is to read a file that a model names."""
        if taken is None:
            return self.model(file)
        self.files |= dict.fromkeys([file, *_buffers(file)])
        if file.suffix.lower() in taken:
            return file
        place, is_new = as_obj(file)
        self.num_converted += is_new
        return place

    def _join_included(self, document: xml.dom.minidom.Document, part: Any, folder: Path) -> None:
        """Puts what MJCF files include in its place; all paths start at the main file."""
        for include in list(part.getElementsByTagName("include")):
            name = include.getAttribute("file")
            file = self.find(name, folder, what="file of an <include>")
            with self._reading(file):
                root: Any = _read_xml(file).documentElement
                included = document.importNode(root, True)
                self._join_included(document, included, folder)
            for child in list(included.childNodes):
                include.parentNode.insertBefore(child, include)
            include.parentNode.removeChild(include)

    @contextlib.contextmanager
    def _reading(self, path: Path) -> Iterator[None]:
        if path in self._open:
            raise ExperimentError(f"{path} includes itself; remove that include")
        self.files[path] = None
        self._open.append(path)
        yield
        self._open.pop()


def _read_xml(path: Path) -> xml.dom.minidom.Document:
    try:
        # Without namespaces, because models use prefixes that they do not declare.
        return xml.dom.expatbuilder.parse(str(path), namespaces=False)
    except (ExpatError, ValueError, OSError) as error:
        raise ExperimentError(f"model {path} is not readable XML ({error}); correct it") from None


def _references(
    document: xml.dom.minidom.Document, suffix: str, folder: Path
) -> Iterator[tuple[Any, Path, frozenset[str] | None]]:
    """XML nodes that name other files, where a relative path starts, and what Drake takes."""
    for compiler in document.getElementsByTagName("compiler"):  # a single one is left
        folder = folder / compiler.getAttribute("meshdir")
    for tag, attribute, taken in _NAMING[suffix]:
        for element in document.getElementsByTagName(tag):
            if attribute:
                yield element.getAttributeNode(attribute), folder, taken
            else:
                for uri in element.getElementsByTagName("uri") or [element]:
                    yield uri.firstChild, folder, taken


def _model_in(folder: Path, what: str) -> Path:
    """The newest model of a folder as Gazebo's, which a `model.config` describes.

    Raises:
        ExperimentError: there is no such description, or it names no model.
    """
    config = folder / "model.config"
    if not config.is_file():
        raise ExperimentError(
            f"{what} is the folder {folder}, which has no model.config; name a file in it"
        )
    document: Any = _read_xml(config)
    named = [
        (
            [int(word) for word in node.getAttribute("version").split(".") if word.isdigit()],
            node.firstChild.nodeValue.strip(),
        )
        for node in document.getElementsByTagName("sdf")
        if node.firstChild is not None
    ]
    if not named:
        raise ExperimentError(f"{config} names no <sdf> file; correct it")
    _, newest = max(named)
    file = folder / newest
    if not file.is_file():
        raise ExperimentError(f"{config} names {file}, which does not exist; correct the path")
    return file.resolve()


def _write_hulls(document: Any) -> bool:
    """Gives meshes of MJCF whose vertices are in the model a file with their hull.

    Returns:
        Whether there are any.
    """
    found = False
    for mesh in document.getElementsByTagName("mesh"):
        if not (vertices := mesh.getAttribute("vertex")) or mesh.getAttribute("file"):
            continue
        points = np.array(vertices.split(), dtype=float).reshape(-1, 3)
        hull = trimesh.Trimesh(points).convex_hull
        text = trimesh.exchange.obj.export_obj(hull, include_normals=False)
        mesh.setAttribute("file", str(cached_copy(f"{mesh.getAttribute('name')}.obj", text)))
        mesh.removeAttribute("vertex")
        found = True
    return found


# What Drake 1.51 and 1.58 take as collision geometry, and draw.
_DRAKE_SUFFIXES = frozenset({".obj", ".vtk", ".gltf"})
_IMAGES = frozenset({".png", ".jpg", ".jpeg", ".ktx2"})
# Elements that name other files: by an attribute, or by their own text or that of a <uri> in them;
# and the suffixes that Drake takes, None for a file that is itself a model.
_NAMING: dict[str, tuple[tuple[str, str, frozenset[str] | None], ...]] = {
    ".urdf": (("mesh", "filename", _DRAKE_SUFFIXES), ("texture", "filename", _IMAGES)),
    ".sdf": (
        ("mesh", "", _DRAKE_SUFFIXES),
        ("include", "", None),
        ("drake:diffuse_map", "", _IMAGES),
    ),
    ".xml": (("mesh", "file", frozenset({".obj"})),),
}


def _buffers(path: Path) -> list[Path]:
    """The files that hold the vertices of a glTF file."""
    if path.suffix.lower() != ".gltf":
        return []
    try:
        buffers = json.loads(path.read_bytes()).get("buffers", [])
        names = [buffer.get("uri", "data:") for buffer in buffers]
    except (ValueError, AttributeError) as error:
        raise ExperimentError(
            f"mesh {path} is not readable glTF ({error}); export it again"
        ) from None
    files = [path.parent / unquote(name) for name in names if not name.startswith("data:")]
    return [file.resolve() for file in files if file.is_file()]


@contextlib.contextmanager
def one_line(
    what: str, copies: Mapping[str, ModelFacts] | None = None
) -> Iterator[list[logging.LogRecord]]:
    """Makes one line of what Drake raises, and keeps what it logs from the terminal.

    What it logs is added to the list that this yields. Of copies in the cache, by their path, an
    error names the file that they were made of.

    Raises:
        ExperimentError: Drake raised something; the text is `what` and Drake's own.
    """
    log = logging.getLogger("drake")
    kept, propagates = logging.handlers.BufferingHandler(sys.maxsize), log.propagate
    log.addHandler(kept)
    log.propagate = False
    try:
        yield kept.buffer
    except ExperimentError:
        raise
    # What pydrake makes of C++ exceptions; some of Drake's checks log what is wrong and then raise
    # SystemExit.
    except (RuntimeError, ValueError, IndexError, SystemExit) as error:
        errors = [r.getMessage() for r in kept.buffer if r.levelno >= logging.ERROR]
        reason = " ".join("; ".join(errors or [str(error)]).split())
        for copy, facts in (copies or {}).items():
            reason = reason.replace(copy, str(facts.path))
        raise ExperimentError(f"{what}: {reason[:500]}") from error
    finally:
        log.removeHandler(kept)
        log.propagate = propagates
