# SPDX-License-Identifier: Apache-2.0
"""Every fault case has a test that runs on every machine, and every mark names a case."""

import re

import fault_cases


def test_the_table_has_a_hundred_cases_in_order():
    assert [case.number for case in fault_cases.cases()] == list(range(1, 101))
    assert all(case.case and case.expected for case in fault_cases.cases())


def test_every_case_is_held_by_a_test_that_no_machine_skips():
    holding = {number for test in fault_cases.held() if not test.may_be_skipped for number in test.numbers}
    missing = {case.number: case.case for case in fault_cases.cases() if case.number not in holding}
    assert missing == {}


def test_every_case_says_in_a_sentence_what_its_tests_do_not_cover():
    said = [case.not_covered for case in fault_cases.cases()]
    assert [words for words in said if not re.fullmatch(r"[A-Z0-9].{30,}[.]", words) or "|" in words] == []
    assert len(set(said)) == 100
    page = fault_cases.page()
    assert all(words in page for words in said)


def test_every_mark_names_a_case():
    known = {case.number for case in fault_cases.cases()}
    assert [test for test in fault_cases.held() if not set(test.numbers) <= known] == []


def test_the_page_lists_every_case_with_its_tests():
    page = fault_cases.page()
    assert page.count("\n| ") == 100 + page.count("| no | case |")
    assert "test_two_recorders_cannot_share_a_folder" in page


def test_a_mark_on_a_file_counts_for_its_tests():
    whole = {number for test in fault_cases.held() if not test.name for number in test.numbers}
    assert whole >= {66, 69, 86, 89}
