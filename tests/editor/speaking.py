"""A client of a language server that is a process: JSON-RPC over its stdin and stdout."""

import json
import subprocess
import sys
import threading
from queue import Queue


class LanguageClient:
    """Starts ``safestage rules lsp``, asks it, and keeps what it publishes."""

    def __init__(self, folder, **capabilities):
        self.process = subprocess.Popen(
            [sys.executable, "-c", "from safestage_eval.cli import main; main()", "rules", "lsp"],
            cwd=folder,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
        )
        self.answers, self.published, self.ids = {}, Queue(), 0
        self.arrived = threading.Condition()
        threading.Thread(target=self._read, daemon=True).start()
        self.about = self.ask(
            "initialize",
            {"processId": None, "rootUri": folder.as_uri(), "capabilities": capabilities},
        )
        self.tell("initialized", {})

    def _read(self):
        out = self.process.stdout
        while header := out.readline():
            length = int(header.split(b":")[1])
            while out.readline().strip():
                pass
            message = json.loads(out.read(length))
            if "id" in message and "method" not in message:
                with self.arrived:
                    self.answers[message["id"]] = message
                    self.arrived.notify_all()
            elif message["method"] == "textDocument/publishDiagnostics":
                self.published.put(message["params"])

    def tell(self, method, params):
        body = {"jsonrpc": "2.0", "method": method, "params": params}
        self._send(body)

    def _send(self, body):
        data = json.dumps(body).encode()
        self.process.stdin.write(b"Content-Length: %d\r\n\r\n%s" % (len(data), data))
        self.process.stdin.flush()

    def ask(self, method, params, seconds=60):
        self.ids += 1
        asked = self.ids
        self._send({"jsonrpc": "2.0", "id": asked, "method": method, "params": params})
        with self.arrived:
            assert self.arrived.wait_for(lambda: asked in self.answers, seconds), method
        answer = self.answers.pop(asked)
        assert "error" not in answer, answer
        return answer["result"]

    def open(self, path, text):
        """Problems of a document that is opened."""
        self.uri, self.version = path.as_uri(), 1
        item = {"uri": self.uri, "languageId": "toml", "version": 1, "text": text}
        self.tell("textDocument/didOpen", {"textDocument": item})
        return self.problems()

    def change(self, text):
        """Problems of the whole new text of the document opened last."""
        self.version += 1
        item = {"uri": self.uri, "version": self.version}
        self.tell(
            "textDocument/didChange", {"textDocument": item, "contentChanges": [{"text": text}]}
        )
        return self.problems()

    def problems(self, seconds=60):
        return self.published.get(timeout=seconds)["diagnostics"]

    def at(self, method, text, offset):
        """Ask about a position, given as characters from the start of the text."""
        before = text[:offset]
        column = before[before.rfind("\n") + 1 :]
        position = {
            "line": before.count("\n"),
            "character": len(column.encode("utf-16-le")) // 2,
        }
        return self.ask(
            f"textDocument/{method}", {"textDocument": {"uri": self.uri}, "position": position}
        )

    def close(self):
        """The server's exit code."""
        self.ask("shutdown", None)
        self.tell("exit", None)
        with self.process:
            return self.process.wait(30)
