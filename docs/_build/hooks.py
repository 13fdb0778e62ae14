"""What MkDocs does besides: generated reference pages, and mathematics without a network."""

from __future__ import annotations

import html
import logging
import re
import sys
from pathlib import Path

from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

sys.path[:0] = [str(Path(__file__).parent), str(Path(__file__).parents[2])]

import reference

_log = logging.getLogger("mkdocs.hooks.selftouch")
_FORMULA = re.compile(r'<(span|div) class="arithmatex">\\([(\[])(.*?)\\[)\]]</\1>', re.DOTALL)


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Drops pages that are not written yet from the navigation, and adds those of the API."""
    # The plugin `offline` would load this script from the network.
    config.extra["polyfills"] = ["javascripts/file_worker.js"]
    config.nav = _existing(config.nav, Path(config.docs_dir))
    return config


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds the reference pages."""
    for path, text in reference.pages().items():
        files.append(File.generated(config, path, content=text))
    return files


def on_page_content(html: str, page: Page, config: MkDocsConfig, files: Files) -> str:
    """Turns formulas into MathML, which browsers draw by themselves."""
    return _FORMULA.sub(_mathml, html)


def _mathml(formula: re.Match[str]) -> str:
    display = "block" if formula[2] == "[" else "inline"
    return convert(html.unescape(formula[3]), display=display)


def _existing(entry: object, docs: Path) -> object:
    """The navigation without pages that are neither there nor generated."""
    if isinstance(entry, list):
        kept = [_existing(item, docs) for item in entry]
        return [item for item in kept if item is not None]
    if isinstance(entry, dict):
        ((title, target),) = entry.items()
        if target == "API":
            return {"API": reference.api_navigation()}
        kept = _existing(target, docs)
        return None if kept in (None, []) else {title: kept}
    if isinstance(entry, str) and not entry.startswith("reference/"):
        if not (docs / entry).is_file():
            _log.info("%s is not written yet", entry)
            return None
    return entry
