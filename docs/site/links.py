"""Every local link of a built site leads somewhere, and nothing is loaded from elsewhere.

    docs/site/links.py HTML

Prints how many pages and links there are, or each link that leads nowhere, with its page.
"""

import posixpath
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

ROOT = Path(sys.argv[1])


class Page(HTMLParser):
    def __init__(self, path):
        super().__init__()
        self.ids, self.links, self.foreign = set(), [], []
        self.feed(path.read_text())

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.ids.update(attrs[key] for key in ("id", "name") if attrs.get(key))
        for link in (attrs[key] for key in ("href", "src") if attrs.get(key)):
            parts = urlsplit(link)
            if not parts.scheme and not parts.netloc:
                self.links.append((link, unquote(parts.path), unquote(parts.fragment)))
            elif tag != "a":
                self.foreign.append(link)


pages = {path.relative_to(ROOT).as_posix(): Page(path) for path in sorted(ROOT.rglob("*.html"))}
wrong = []
for name, page in pages.items():
    wrong += [f"{name}: {link} is loaded from elsewhere" for link in page.foreign]
    for link, path, anchor in page.links:
        target = posixpath.normpath(posixpath.join(posixpath.dirname(name), path)) if path else name
        if path.startswith("/") or target.startswith("../"):
            wrong.append(f"{name}: {link} leaves the site")
        elif not (ROOT / target).is_file():
            wrong.append(f"{name}: {link} leads to no file")
        elif anchor and target in pages and anchor not in pages[target].ids:
            wrong.append(f"{name}: {link} leads to no heading")
print("\n".join(sorted(set(wrong))), end="\n" if wrong else "", file=sys.stderr)
if wrong:
    sys.exit(1)
# The first page once more, and the contents for browsers without scripts.
own = pages.keys() - {"index.html", "toc.html"}
print(f"{len(own)} pages, {sum(len(page.links) for page in pages.values())} links")
