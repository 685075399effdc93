// SPDX-License-Identifier: Apache-2.0
// The template of the report's page.
#pragma once

namespace gs {

/// The text of eval/report/report_page.html: the body of write_report's page, with the placeholders {{tables}},
/// {{frames}}, {{plots}}, {{stability}}, {{program}} and {{pictures}} in this order.
extern const char* const kReportPage;

}  // namespace gs
