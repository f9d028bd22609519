"""A body as an MJCF file, for MuJoCo's own viewer or other programs."""

import warnings
from pathlib import Path

import mujoco

from sim2vr_harness.base.files import naming
from sim2vr_harness.users.bodies.body import Body


def export_body(body: Body, file: Path) -> list[Path]:
    """Writes a body, devices included, as MJCF that MuJoCo loads again and that moves the same.

    Meshes and textures that are files are copied into a folder beside it, FILE_assets.

    Args:
        file: where to; its folder must exist.

    Returns:
        The files that were written, the MJCF first.

    Raises:
        ValueError: the folder does not exist, or the body has something that MJCF cannot say.
    """
    if not file.parent.is_dir():
        raise ValueError(f"file: got {str(file)!r}, expected a file in a folder that exists")
    spec = body.spec()
    copies = _copied_assets(spec, file)
    with warnings.catch_warnings():  # about attached specifications, which are checked below
        warnings.simplefilter("ignore", UserWarning)
        model = spec.compile()
        # Every number exactly as it is in the specification; compiled ones have six digits.
        spec.compiler.savecompiled = False
        text = spec.to_xml()
    with naming(file):
        file.write_text(text, encoding="utf-8")
    try:
        again = mujoco.MjModel.from_xml_path(str(file))
    except ValueError as error:
        raise ValueError(f"file: wrote {str(file)!r}, which MuJoCo refuses: {error}") from error
    for size in ("nq", "nv", "nu", "nbody", "nsite", "ntendon", "neq"):
        if getattr(again, size) != getattr(model, size):
            raise ValueError(
                f"file: wrote {str(file)!r}, which has {size} {getattr(again, size)}, expected "
                f"{getattr(model, size)}: the body has something that MJCF cannot say"
            )
    return [file, *copies]


def _copied_assets(spec: mujoco.MjSpec, file: Path) -> list[Path]:
    """Copies files beside the MJCF and has the specification name them."""
    folder = file.parent / f"{file.stem}_assets"
    copies: dict[Path, Path] = {}
    for kind, assets in (("meshdir", spec.meshes), ("texturedir", spec.textures)):
        for asset in assets:
            if not asset.file:
                continue
            source = _source(spec, asset, kind)
            if source not in copies:
                folder.mkdir(exist_ok=True)
                copies[source] = folder / f"{len(copies)}_{source.name}"
                with naming(copies[source]):
                    copies[source].write_bytes(source.read_bytes())
            asset.file = str(copies[source].resolve())
    return list(copies.values())


def _source(spec: mujoco.MjSpec, asset: mujoco.MjsMesh | mujoco.MjsTexture, kind: str) -> Path:
    named = Path(asset.file)
    folder = getattr(asset.compiler, kind) or getattr(spec.compiler, kind) or "."
    base = Path(spec.modelfiledir or ".")
    for place in (named, Path(folder) / named, base / folder / named, base / named):
        if place.is_file():
            return place.resolve()
    raise ValueError(f"{asset.name}: got the file {asset.file!r}, which was not found")
