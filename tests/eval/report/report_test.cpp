// SPDX-License-Identifier: Apache-2.0
// The parts of the HTML page; tests/web opens the whole.
#include "eval/report/report.h"

#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "lib/core/json_text.h"
#include "lib/model/run_folder.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

constexpr const char* kOdd = "</script><b>&\"{{tables}}";

Image grey(int width, int height, std::uint8_t value) {
    Image image{width, height, 3, {}, {}};
    image.u8.assign(std::size_t(width) * height * 3, value);
    return image;
}

/// Two runs with pictures of three views; the second was not decomposed.
class Report : public ::testing::Test {
  protected:
    Report() {
        for (const char* name : {"a", "b"}) {
            RunResult row;
            row.folder = tmp_.path() / name;
            row.run = name, row.scene = kOdd, row.dataset = "set", row.model = kOdd;
            row.protocol = {{"line", kOdd}};
            row.psnr = name[0] == 'a' ? 20 : 22, row.ssim = 0.5;
            row.iteration = 7;
            row.train_seconds = 3;
            const RunFolder folder{row.folder};
            for (int i = 0; i < 3; ++i) {
                write_image(folder.render("test", 7, i), grey(100, 50, std::uint8_t(80 + i)));
                write_image(folder.ground_truth("test", 7, i), grey(100, 50, 70));
                if (name[0] == 'a') write_image(folder.picture_part("test", 7, "base", i), grey(100, 50, 9));
            }
            std::ofstream(folder.per_view())
                << R"({"image_names": {"ours_7": {"00000.png": "x", "00001.png": "<y>", "00002.png": "z"}}})";
            rows_.push_back(row);
        }
    }
    test::TemporaryFolder tmp_;
    std::vector<RunResult> rows_;
};

TEST_F(Report, ShowsTheCorrectionsOfLearnedCameras) {
    EXPECT_EQ(report_cameras(compare_runs(rows_), {}), "") << "no run has learned cameras";
    const RunFolder folder{rows_[0].folder};
    auto entry = [](const char* name, const char* split) {
        nlohmann::json pose = {{"position", {0, 0, 0}},
                               {"fx", 9},
                               {"fy", 9},
                               {"cx", 5},
                               {"cy", 5},
                               {"rotation", {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}}};
        nlohmann::json json = pose;
        json["img_name"] = name, json["split"] = split, json["width"] = 10, json["height"] = 10, json["given"] = pose;
        return json;
    };
    nlohmann::json list = {entry("test", "test"), entry("near", "train"), entry("<far>", "train")};
    list[1]["correction"] = 0.25, list[2]["correction"] = 4.5;
    std::ofstream(folder.cameras()) << list;
    write_image(folder.correction(0), grey(20, 10, 50));
    const std::string html = report_cameras(compare_runs(rows_), {});
    EXPECT_NE(html.find("&lt;far&gt;, 4.50 pixels\"><figcaption>"), std::string::npos) << html;
    EXPECT_NE(html.find("near: 0.25 pixels"), std::string::npos) << "in the plot";
    EXPECT_EQ(html.find("near, 0.25 pixels"), std::string::npos) << "has no picture";
    EXPECT_EQ(html.find("<far>"), std::string::npos);
    EXPECT_NE(html.find("data:image/jpeg;base64,"), std::string::npos);
}

TEST_F(Report, TablesEscapeNamesAndMarkTheBest) {
    const std::string html = report_tables(compare_runs(rows_));
    EXPECT_EQ(html.find("<b>"), std::string::npos) << html;
    EXPECT_NE(html.find("&lt;/script&gt;&lt;b&gt;&amp;&quot;"), std::string::npos) << html;
    EXPECT_NE(html.find("<span class=\"place1\">22.00<sup title=\"place 1\">1</sup></span>"), std::string::npos)
        << html;
    EXPECT_NE(html.find("<p class=\"protocol\">"), std::string::npos);
}

TEST_F(Report, FrameTimesStandWhereTheyWereMeasured) {
    rows_[1].frame_times = FrameTimes{"<gpu>", 8, 100, 0.002, 0.0015, 0.001, 0.004};
    const std::string html = report_frame_times(compare_runs(rows_));
    EXPECT_NE(html.find("<td>&lt;gpu&gt;</td>"), std::string::npos) << html;
    EXPECT_NE(html.find("<td class=\"number\">1.500</td>"), std::string::npos) << html;
    EXPECT_NE(html.find("<p class=\"protocol\">frame times at 1280x720"), std::string::npos) << html;
    EXPECT_NE(html.find("Not measured: a. <code>gsapp bench frames RUN</code>"), std::string::npos) << html;
    rows_[0].frame_times = rows_[1].frame_times;
    EXPECT_EQ(report_frame_times(compare_runs(rows_)).find("Not measured"), std::string::npos);
    rows_[0].frame_times.reset(), rows_[1].frame_times.reset();
    EXPECT_EQ(report_frame_times(compare_runs(rows_)).find("<table>"), std::string::npos);
}

TEST_F(Report, StabilityIsOfTheModelsInTheTable) {
    rows_[0].model = "nasg", rows_[1].model = "sh (degree 3)";
    const std::string html = report_stability(compare_runs(rows_));
    for (const char* there :
         {"<th scope=\"row\">softplus</th>", "<th scope=\"row\">nasg</th>", "<th scope=\"row\">sh</th>"})
        EXPECT_NE(html.find(there), std::string::npos) << there;
    EXPECT_EQ(html.find("<th scope=\"row\">sv</th>"), std::string::npos);
}

TEST_F(Report, PlotsHaveAPointForEachLineWithItsCost) {
    rows_[1].train_seconds.reset();
    const std::string svg = report_plots(compare_runs(rows_));
    std::size_t circles = 0;
    for (std::size_t at = svg.find("<circle"); at != std::string::npos; at = svg.find("<circle", at + 1)) ++circles;
    EXPECT_EQ(circles, 1u) << svg;
    EXPECT_EQ(svg.find("<b>"), std::string::npos) << svg;
    EXPECT_EQ(svg.find("nan"), std::string::npos) << "one point alone has axes, too: " << svg;
    EXPECT_EQ(svg.find("bytes"), std::string::npos) << "nobody has that cost";
}

TEST_F(Report, PicturesAreEvenlySpreadShrunkAndKeptOnce) {
    const std::string text = report_pictures(compare_runs(rows_), {2, 40});
    EXPECT_EQ(text.find('<'), std::string::npos) << "could end the script element";
    const auto json = parse_json(text);
    ASSERT_EQ(json["scenes"].size(), 1u);
    const auto& scene = json["scenes"][0];
    EXPECT_EQ(scene["name"], kOdd);
    EXPECT_EQ(scene["views"], (nlohmann::json{"x", "<y>"}));
    const auto &first = scene["runs"][0]["layers"], &second = scene["runs"][1]["layers"];
    EXPECT_EQ(first["reference"], second["reference"]) << "the same photograph";
    EXPECT_EQ(first["reference"][0], first["reference"][1]) << "both are of one grey";
    EXPECT_GE(first["base"][0], 0);
    EXPECT_EQ(second["base"], (nlohmann::json{-1, -1}));
    EXPECT_EQ(first["residual"], (nlohmann::json{-1, -1}));
    // Renders 80 and 81, photograph 70, base 9, errors 40 and 44.
    EXPECT_EQ(json["images"].size(), 6u);
    for (const auto& uri : json["images"])
        EXPECT_TRUE(uri.get<std::string>().starts_with("data:image/jpeg;base64,/9j/"));
}

TEST_F(Report, ThePageIsWholeAndAsksForNothing) {
    const auto path = tmp_.path() / "out" / "page.html";
    write_report(path, compare_runs(rows_), {});
    std::ifstream file(path);
    const std::string page{std::istreambuf_iterator<char>(file), {}};
    EXPECT_TRUE(page.ends_with("</html>\n"));
    for (const char* mark :
         {"{{frames}}", "{{plots}}", "{{stability}}", "{{program}}", "{{pictures}}", "http://", "https://"})
        EXPECT_EQ(page.find(mark), std::string::npos) << mark;
    EXPECT_NE(page.find("{{tables}}"), std::string::npos) << "a user's text stays as it is";
}

TEST_F(Report, RunsWithoutPicturesHaveTheirTables) {
    std::filesystem::remove_all(tmp_.path() / "a");
    std::filesystem::remove_all(tmp_.path() / "b");
    const auto json = parse_json(report_pictures(compare_runs(rows_), {}));
    EXPECT_TRUE(json["scenes"].empty());
}

}  // namespace
}  // namespace gs
