// SPDX-License-Identifier: Apache-2.0
// The template of the report's page.
#pragma once

namespace gs {

/// eval/report/report_page.html: the body of write_report's page, with {{tables}}, {{plots}}, {{program}} and {{pictures}}, in this order, to be filled in.
extern const char* const kReportPage;

}  // namespace gs
