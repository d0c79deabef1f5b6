"""A language server for rule files: ``safestage rules lsp``, spoken over stdin and stdout."""

from __future__ import annotations

from pathlib import Path

from lsprotocol import types
from pygls.lsp.server import LanguageServer
from pygls.uris import to_fs_path
from pygls.workspace import TextDocument

from safestage_eval.errors import RuleError
from safestage_eval.rules.diagnostic import Diagnostic
from safestage_eval.version import __version__

from .known_names import KnownNames, names_known
from .rule_completion import Offer, complete
from .rule_hover import page_at
from .rule_problems import is_rule_file, problems_of

_KINDS = {
    "signal": types.CompletionItemKind.Function,
    "relation": types.CompletionItemKind.Function,
    "state": types.CompletionItemKind.Function,
    "phase": types.CompletionItemKind.Event,
    "parameter": types.CompletionItemKind.Constant,
    "column": types.CompletionItemKind.Field,
    "unit": types.CompletionItemKind.Unit,
    "role": types.CompletionItemKind.Variable,
    "tag": types.CompletionItemKind.EnumMember,
    "key": types.CompletionItemKind.Property,
    "word": types.CompletionItemKind.Keyword,
    "name": types.CompletionItemKind.Reference,
}
_TRIGGERS = ['"', "(", "[", ",", " ", "{", "="]


def make_server() -> LanguageServer:
    """The server, ready to be started."""
    server = LanguageServer("safestage-rules", __version__)
    known_to: dict[str, KnownNames] = {}

    def publish(uri: str) -> None:
        document = server.workspace.get_text_document(uri)
        text = document.source
        problems = problems_of(_path(document), text, _open_texts(server))
        server.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(
                uri, [_diagnostic(document, one) for one in problems], document.version
            )
        )

    def publish_all() -> None:
        """Texts of every open file: one may extend another."""
        for uri in list(server.workspace.text_documents):
            publish(uri)

    def known_in(document: TextDocument) -> KnownNames:
        """The names at hand; as they were before where no file that it extends can be read now."""
        try:
            names = names_known(_path(document), document.source, _open_texts(server))
        except RuleError:
            names = None
        if names is not None and (names.files or document.uri not in known_to):
            known_to[document.uri] = names
        return known_to[document.uri]

    def opened(params: types.DidOpenTextDocumentParams) -> None:
        publish(params.text_document.uri)

    def changed(params: types.DidChangeTextDocumentParams) -> None:
        publish(params.text_document.uri)

    def saved(_: types.DidSaveTextDocumentParams) -> None:
        publish_all()

    def closed(params: types.DidCloseTextDocumentParams) -> None:
        known_to.pop(params.text_document.uri, None)
        server.text_document_publish_diagnostics(
            types.PublishDiagnosticsParams(params.text_document.uri, [])
        )

    def completion(params: types.CompletionParams) -> types.CompletionList | None:
        document = server.workspace.get_text_document(params.text_document.uri)
        if not is_rule_file(document.source) and document.source.strip():
            return None
        offset = document.offset_at_position(params.position)
        completions = complete(document.source, offset, known_in(document))
        start = _position(document, offset - completions.replaces)
        place = types.Range(start, params.position)
        snippets = _takes_snippets(server)
        items = [
            _item(offer, place, f"{at:04}", snippets=snippets)
            for at, offer in enumerate(completions.offers)
        ]
        return types.CompletionList(is_incomplete=False, items=items)

    def hover(params: types.HoverParams) -> types.Hover | None:
        document = server.workspace.get_text_document(params.text_document.uri)
        if not is_rule_file(document.source):
            return None
        offset = document.offset_at_position(params.position)
        page = page_at(document.source, offset, known_in(document))
        if page is None:
            return None
        place = types.Range(_position(document, page.start), _position(document, page.stop))
        markdown = types.MarkupContent(types.MarkupKind.Markdown, page.markdown)
        return types.Hover(contents=markdown, range=place)

    triggers = types.CompletionOptions(trigger_characters=_TRIGGERS)
    server.feature(types.TEXT_DOCUMENT_DID_OPEN)(opened)
    server.feature(types.TEXT_DOCUMENT_DID_CHANGE)(changed)
    server.feature(types.TEXT_DOCUMENT_DID_SAVE)(saved)
    server.feature(types.TEXT_DOCUMENT_DID_CLOSE)(closed)
    server.feature(types.TEXT_DOCUMENT_COMPLETION, triggers)(completion)
    server.feature(types.TEXT_DOCUMENT_HOVER)(hover)
    return server


def _path(document: TextDocument) -> Path:
    """Path of a document; a name in the current folder if it was never saved."""
    return Path(to_fs_path(document.uri) or "untitled.toml").resolve()


def _open_texts(server: LanguageServer) -> dict[Path, str]:
    return {_path(one): one.source for one in server.workspace.text_documents.values()}


def _position(document: TextDocument, offset: int) -> types.Position:
    """In the client's units (UTF-16 by default) of a number of characters from the start."""
    before = document.source[:offset]
    line = before.count("\n")
    column = offset - (before.rfind("\n") + 1)
    position = types.Position(line, column)
    return document.position_codec.position_to_client_units(document.lines, position)


def _diagnostic(document: TextDocument, diagnostic: Diagnostic) -> types.Diagnostic:
    codec, line = document.position_codec, diagnostic.line - 1
    length = len(document.lines[line].rstrip("\r\n")) if line < len(document.lines) else 0
    start = types.Position(line, min(diagnostic.column - 1, length))
    stop = types.Position(line, min(diagnostic.column - 1 + diagnostic.length, length))
    message = diagnostic.what
    message += f"\nallowed: {diagnostic.allowed}" if diagnostic.allowed else ""
    message += f"\nfix: {diagnostic.fix}" if diagnostic.fix else ""
    return types.Diagnostic(
        range=types.Range(
            codec.position_to_client_units(document.lines, start),
            codec.position_to_client_units(document.lines, stop),
        ),
        message=message,
        severity=types.DiagnosticSeverity.Error,
        code=diagnostic.code,
        source="safestage",
    )


def _takes_snippets(server: LanguageServer) -> bool:
    about = server.client_capabilities.text_document
    completion = about and about.completion
    item = completion and completion.completion_item
    return bool(item and item.snippet_support)


def _item(offer: Offer, place: types.Range, order: str, *, snippets: bool) -> types.CompletionItem:
    text = offer.insert or offer.label
    form = types.InsertTextFormat.PlainText
    if snippets and offer.arguments:
        called = f"({', '.join(offer.arguments)})"
        fields = ", ".join(f"${{{at}:{name}}}" for at, name in enumerate(offer.arguments, 1))
        text = text.replace(called, f"({fields})")
        form = types.InsertTextFormat.Snippet
    return types.CompletionItem(
        label=offer.label,
        kind=_KINDS[offer.kind],
        detail=offer.detail or None,
        documentation=offer.meaning or None,
        sort_text=order,
        filter_text=text if text[:1] == '"' else offer.label,
        insert_text_format=form,
        text_edit=types.TextEdit(place, text),
    )
