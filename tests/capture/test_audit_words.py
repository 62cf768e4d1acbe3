"""What is said of an audit at once, and what is left to the file."""

from __future__ import annotations

from ibrpipe.capture.audit_words import below, sentence, terminal_summary, worst_warnings
from ibrpipe.capture.findings import by_harm
from ibrpipe.io.documents.audit import Finding


def warning(kind, file="a", value="v"):
    return Finding("warning", kind, file, value, "e", "r")


def test_findings_are_sorted_by_severity_then_by_harm_and_stay_in_order_within_a_kind():
    found = [
        Finding("note", "decided", "c", "n", "", ""),
        warning("clipped", "x"),
        warning("clipped", "y"),
        warning("never heard of"),
        warning("left out"),
        warning("sees nothing"),
        Finding("error", "unreadable", "f", "", "", ""),
    ]
    kinds = [(finding.kind, finding.file) for finding in by_harm(found)]
    assert kinds == [
        ("unreadable", "f"), ("sees nothing", "a"), ("left out", "a"), ("clipped", "x"), ("clipped", "y"),
        ("never heard of", "a"), ("decided", "c"),
    ]  # fmt: skip


def test_one_warning_of_every_kind_is_shown_and_the_rest_counted():
    found = [warning("clipped", name) for name in "abc"] + [warning("blurred"), warning("left out", value="4 photos")]
    found += [warning("left out", value="2 masks"), warning("outline", "z")]
    shown, more = worst_warnings(found, 4)
    assert shown == ["z: v; expected e: r", "4 photos", "2 masks", "a: v; expected e: r"]
    assert more == 3
    assert worst_warnings(found)[0][-1] == "a: v; expected e: r (and 2 more like this)"
    assert worst_warnings([]) == ([], 0)


def test_files_are_named_from_the_capture_folder_on():
    finding = warning("thin coverage", "/data/cap/mesh.ply", "/data/cap holds 2, in /data/cap/images")
    assert sentence(below(finding, "/data/cap")) == "mesh.ply: cap holds 2, in images; expected e: r"
    assert below(finding, "") == finding


def test_the_terminal_shows_counts_warnings_and_decisions():
    found = [warning("few", "/c/p", "holds 3 photos"), Finding("note", "decided", "p", "mesh of /c/p/x.ply", "", "")]
    assert terminal_summary(found, "/c/p", 3, 0) == (
        "3 photos to build from, 0 held out\nwarning: p: holds 3 photos; expected e: r\nnote: mesh of x.ply\n"
    )
    many = [warning(kind) for kind in ("few", "outline", "black", "blurred", "clipped", "no mask", "no test", "odd")]
    assert "2 more warnings in audit.txt\n" in terminal_summary(many, "", 3, 0)
    alike = [warning("few"), warning("few")]
    assert "(and 1 more like this)\nall of them in audit.txt\n" in terminal_summary(alike, "", 3, 0)
