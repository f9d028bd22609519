"""Reports of evaluations and studies: one HTML file that opens offline, and figures for papers."""

from sim2vr_harness.studies.report.write import PAGE, StudyReport, write_report

__all__ = ["PAGE", "StudyReport", "write_report"]
