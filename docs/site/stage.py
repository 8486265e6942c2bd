"""What mdBook reads: the pages of SUMMARY.md, their pictures, and pages with the files to which they link.

    docs/site/stage.py SRC

Run in the root of the repository. A browser would save a law or a scene instead of showing it; hence links to
such files, and to folders, lead to one page for each folder. Pages and pictures keep their paths.
"""

import os
import re
import subprocess
import sys
from pathlib import Path
from posixpath import basename, dirname, join, normpath, relpath, splitext

SRC = Path(sys.argv[1])
# Longer files are not shown: who follows a link to one gets it as it is.
SHOWN = 60_000
FENCES = {".geo": "text", ".mjs": "js", ".rs": "rust,ignore", "": "sh"}
# Fences and words in backticks hold no links; else it is the target of one.
LINK = re.compile(r"(?ms)^ *(`{3,})[^`\n]*\n.*?^ *\1 *$|`[^`\n]+`|(?<=\]\()(?P<target>[^)\s]+)")

listed = subprocess.check_output(["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"])
files = {file for file in listed.decode().split("\0") if os.path.isfile(file)}
# There, paths begin where it stands, so that they lead somewhere in the repository as well.
summary = Path("docs/site/SUMMARY.md").read_text().replace("](../../", "](")
pages = re.findall(r"\]\((.+?\.md)\)", summary)
folders = {}


def write(file, content):
    to = SRC / file
    to.parent.mkdir(parents=True, exist_ok=True)
    to.write_bytes(content)


def inside(folder):
    return {file for file in files - set(pages) if dirname(file) == folder}


def text(file):
    """None if it is too long, or no text."""
    try:
        return Path(file).read_text() if os.path.getsize(file) <= SHOWN else None
    except UnicodeDecodeError:
        return None


def page_of(folder):
    return f"files/{folder.replace('/', '-').lstrip('.') or 'root'}.md"


def led(page, link):
    """The link as it is on the site."""
    path, _, _ = link.partition("#")
    file = normpath(join(dirname(page), path))
    if not path or "://" in path or file in pages:
        return link
    if any(other.startswith(file + "/") for other in files):
        folder, some, anchor = file, inside(file), ""
    elif file not in files:
        return link  # The check of links says so.
    elif file.endswith(".md"):
        sys.exit(f"{page} links to {file}, which docs/site/SUMMARY.md does not list")
    elif text(file) is None:
        write(file, Path(file).read_bytes())
        return link
    else:
        folder, some, anchor = dirname(file), {file}, "#" + basename(file)
        if folder.startswith("examples/"):
            some = inside(folder)  # A scene is read together with its law.
    folders.setdefault(folder, set()).update(some)
    return relpath(page_of(folder), dirname(page)) + anchor


def section(file):
    name, content = basename(file), text(file)
    head = f"\n## `{name}` {{#{name}}}\n\n"
    if content is None:
        return f"{head}{os.path.getsize(file)} bytes, not shown.\n"
    ending = splitext(name)[1]
    return f"{head}``````{FENCES.get(ending, ending[1:])}\n{content.rstrip()}\n``````\n"


if missing := [page for page in pages if page not in files]:
    sys.exit(f"docs/site/SUMMARY.md lists what is not there: {' '.join(missing)}")
own = [file for file in files if file.endswith(".md") and not file.startswith("docs/site/")]
expected = {file for file in own if file.startswith(("docs/", "examples/")) or "/" not in file}
if left_out := sorted(expected - set(pages)):
    sys.exit(f"docs/site/SUMMARY.md does not list {' '.join(left_out)}")

for page in pages:
    new = LINK.sub(lambda it: led(page, it["target"]) if it["target"] else it[0], Path(page).read_text())
    write(page, new.encode())
index = "# Files\n\nFiles to which the pages lead, as they stand in the repository.\n\n"
summary += "\n# Files\n\n- [Files](files/index.md)\n"
for folder, some in sorted(folders.items()):
    page, title = page_of(folder), folder or "The root"
    within = {file[len(folder) + 1 :] for file in files if folder and file.startswith(folder + "/")}
    below = sorted({f"`{file.split('/')[0]}`" for file in within if "/" in file})
    head = f"# {title}\n" + (f"\nFolders in it: {', '.join(below)}.\n" if below else "")
    write(page, (head + "".join(map(section, sorted(some)))).encode())
    index += f"- [{title}]({basename(page)})\n"
    summary += f"  - [{title}]({page})\n"
write("files/index.md", index.encode())
write("SUMMARY.md", summary.encode())
