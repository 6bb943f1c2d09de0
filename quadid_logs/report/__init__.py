"""The result for people and for programs: view, HTML, text, JSON."""

from quadid_logs.report.folder import check_folder, report_folders, write_report
from quadid_logs.report.json import json_text, result_dict
from quadid_logs.report.provenance import provenance_of

__all__ = ["check_folder", "json_text", "provenance_of", "report_folders", "result_dict", "write_report"]
