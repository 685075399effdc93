// SPDX-License-Identifier: Apache-2.0
// Which runs are one experiment, means and places, and every format with odd names.
#include "eval/report/comparison.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "eval/pages/escape.h"
#include "kernels/base/error.h"
#include "lib/core/json_text.h"
#include "tests/core/temporary_folder.h"

namespace gs {
namespace {

using test::TemporaryFolder;

const char* const kLine = "protocol paper: ...";

/// A run of scene `scene` with the options that matter for grouping.
RunResult run_of(const std::string& run, const std::string& scene, const std::string& model, double psnr,
                 std::uint64_t seed = 0) {
    RunResult result;
    result.run = run, result.dataset = "set", result.scene = scene, result.model = model, result.strategy = "mcmc";
    result.psnr = psnr, result.ssim = psnr / 100;
    result.protocol = {{"name", "paper"}, {"line", kLine}, {"ppisp_eval", "off"}};
    result.seed = seed;
    result.training = {{"appearance", model}, {"source", scene}, {"cap-max", "100"}};
    return result;
}

TEST(ColumnStats, HandComputed) {
    const ColumnStats up = column_stats({1, 2, 3, 6}, Better::kHigher);
    EXPECT_EQ(up.mean, 3);
    EXPECT_NEAR(*up.deviation, std::sqrt((4 + 1 + 0 + 9) / 3.0), 1e-12) << "n - 1";
    EXPECT_EQ(up.worst, 1);
    EXPECT_EQ(up.worst_run, 0u);
    EXPECT_EQ(column_stats({1, 2, 3, 6}, Better::kLower).worst, 6);
    EXPECT_EQ(column_stats({1, 2, 3, 6}, Better::kLower).worst_run, 3u);
    EXPECT_EQ(column_stats({1, 2, 3, 6}, Better::kNeither).worst, 3) << "no direction, no worst";
    EXPECT_FALSE(column_stats({5}, Better::kHigher).deviation);
    EXPECT_FALSE(column_stats({5, std::numeric_limits<double>::infinity()}, Better::kHigher).deviation);
}

TEST(Comparison, RunsThatDifferOnlyBySeedAreOneLine) {
    RunResult other = run_of("d", "lego", "sh", 24);
    other.training["cap-max"] = "50";
    RunResult without = run_of("e", "lego", "sh", 25), without_too = run_of("f", "lego", "sh", 26);
    without.training.clear(), without_too.training.clear();
    RunResult later = run_of("g", "lego", "sh", 27);
    later.iteration = 7;
    const Comparison c = compare_runs(
        {run_of("b", "lego", "sh", 22, 1), other, run_of("a", "lego", "sh", 20, 0), without, without_too, later});
    ASSERT_EQ(c.tables.size(), 1u);
    const auto& lines = c.tables[0].lines;
    ASSERT_EQ(lines.size(), 5u);
    EXPECT_EQ(lines[0].label, "a .. b (2 runs)") << "by seed";
    EXPECT_EQ(lines[0].values[0]->mean, 21);
    EXPECT_NEAR(*lines[0].values[0]->deviation, std::sqrt(2.0), 1e-12);
    EXPECT_EQ(lines[0].values[0]->worst, 20);
    EXPECT_EQ(lines[1].label, "d");
    EXPECT_NE(lines[1].options.find("cap-max 50"), std::string::npos) << lines[1].options;
    EXPECT_NE(lines[0].options.find("cap-max 100"), std::string::npos);
    EXPECT_EQ(lines[2].num_runs, 1u) << "without options a run stands for itself";
    EXPECT_EQ(lines[4].label, "g");
}

TEST(Comparison, AMetricThatOneRunLacksHasNoMean) {
    RunResult a = run_of("a", "lego", "sh", 20, 0), b = run_of("b", "lego", "sh", 22, 1);
    a.scores["FLIP"].value = 0.1;
    const Comparison c = compare_runs({a, b});
    const auto flip =
        std::find_if(c.columns.begin(), c.columns.end(), [](const Column& column) { return column.key == "FLIP"; });
    ASSERT_NE(flip, c.columns.end());
    EXPECT_FALSE(c.tables[0].lines[0].values[flip - c.columns.begin()]);
}

TEST(Comparison, DatasetsAverageTheirScenesRunByRun) {
    const Comparison c = compare_runs({run_of("a0", "lego", "sh", 20, 0), run_of("a1", "lego", "sh", 24, 1),
                                       run_of("b1", "chair", "sh", 32, 1), run_of("b0", "chair", "sh", 30, 0),
                                       run_of("n", "lego", "none", 10, 0)});
    ASSERT_EQ(c.tables.size(), 3u);
    EXPECT_EQ(c.tables[0].scene, "lego");
    const ComparisonTable& dataset = c.tables[2];
    EXPECT_EQ(dataset.scene, "");
    EXPECT_EQ(dataset.dataset, "set");
    ASSERT_EQ(dataset.lines.size(), 2u);
    const ColumnStats& psnr = *dataset.lines[0].values[0];
    EXPECT_EQ(psnr.mean, 26.5);
    EXPECT_NEAR(*psnr.deviation, std::sqrt(4.5), 1e-12) << "of 25 and 28";
    EXPECT_EQ(psnr.worst, 25);
    EXPECT_EQ(psnr.place, 0) << "the other line misses a scene";
    EXPECT_EQ(dataset.lines[1].num_scenes, 1u);
    // Other seeds: the scenes' means, without deviation.
    const Comparison odd = compare_runs(
        {run_of("a0", "lego", "sh", 20, 0), run_of("a1", "lego", "sh", 24, 1), run_of("b", "chair", "sh", 30, 0)});
    EXPECT_EQ(odd.tables[2].lines[0].values[0]->mean, 26);
    EXPECT_FALSE(odd.tables[2].lines[0].values[0]->deviation);
}

TEST(Comparison, PlacesFollowTheDirectionOfTheColumn) {
    std::vector<RunResult> runs;
    const double psnr[] = {20, 25, 24, 25.001, 10}, flip[] = {0.3, 0.1, 0.2, 0.4, 0.5};
    for (int i = 0; i < 5; ++i) {
        runs.push_back(run_of(std::string(1, char('a' + i)), "lego", "m" + std::to_string(i), psnr[i]));
        runs.back().scores = {{"FLIP", {flip[i], ""}}, {"odd", {1.0 * i, ""}}};
        runs.back().num_gaussians = i;
        runs.back().train_seconds = 7;
    }
    const Comparison c = compare_runs(runs);
    const auto places = [&](const std::string& key) {
        const auto column =
            std::find_if(c.columns.begin(), c.columns.end(), [&](const Column& x) { return x.key == key; }) -
            c.columns.begin();
        std::vector<int> out;
        for (const ComparisonLine& line : c.tables[0].lines) out.push_back(line.values[column]->place);
        return out;
    };
    EXPECT_EQ(places("PSNR"), (std::vector<int>{0, 1, 3, 1, 0})) << "what reads the same shares its place";
    EXPECT_EQ(places("FLIP"), (std::vector<int>{3, 1, 2, 0, 0}));
    EXPECT_EQ(places("odd"), (std::vector<int>(5, 0))) << "nobody knows what is better";
    EXPECT_EQ(places("num_gaussians"), (std::vector<int>(5, 0)));
    EXPECT_EQ(places("train_seconds"), (std::vector<int>(5, 0))) << "all equal";
}

TEST(Comparison, MixedProtocolsAreRefusedByName) {
    RunResult a = run_of("first", "lego", "sh", 20), b = run_of("second", "lego", "sv", 21),
              c = run_of("third", "lego", "nasg", 21);
    b.protocol["line"] = "protocol inria: ...", c.protocol = nullptr;
    try {
        compare_runs({a, b, c});
        FAIL();
    } catch (const UsageError& e) {
        const std::string message = e.what();
        for (const char* part :
             {"first: protocol paper", "second: protocol inria", "third: protocol not stated", "--protocol"})
            EXPECT_NE(message.find(part), std::string::npos) << message;
    }
    EXPECT_NO_THROW(compare_runs({c, c}));
    a.folder = "x/y";
    EXPECT_THROW(compare_runs({a, a}), UsageError) << "named twice";
}

TEST(Columns, MetricsThatAreMissingSaySoWhereSomebodyWantsThem) {
    RunResult result = run_of("a", "lego", "sh", 20);
    const auto table = [](const std::vector<RunResult>& runs) {
        return format_comparison(compare_runs(runs), TableFormat::kMarkdown);
    };
    for (const char* absent : {"| LPIPS", "| DISTS", "| MILO", "| FLIP", "not measured"})
        EXPECT_EQ(table({result}).find(absent), std::string::npos) << table({result});
    RunResult asked = run_of("b", "lego", "sv", 20), measured = run_of("c", "lego", "nasg", 20);
    asked.scores["MILO"].reason = "not measured: no weights (see ...)";
    EXPECT_NE(table({asked}).find("|       MILO |"), std::string::npos) << table({asked});
    EXPECT_NE(table({asked}).find("| no weights |"), std::string::npos) << table({asked});
    measured.scores["LPIPS-VGG"].value = 0.125;
    EXPECT_NE(table({result, measured}).find(" 0.1250 |"), std::string::npos);
    EXPECT_NE(table({result, measured}).find("| not measured |"), std::string::npos) << "the other one";
}

class Formats : public ::testing::Test {
  protected:
    Formats() {
        RunResult odd = run_of("a_b|c", "x,\"y\"", "50%", 27.126), repeated = run_of("r0", "x,\"y\"", "<b>&", 20, 0),
                  again = run_of("r1", "x,\"y\"", "<b>&", 21, 1);
        odd.strategy.clear();
        odd.scores["LPIPS-VGG"].reason = "not measured: no weights";
        odd.num_gaussians = 10000, odd.ssim = 0.91234, odd.train_seconds = 125,
        odd.peak_device_bytes = std::int64_t(3) << 29;
        comparison_ = compare_runs({odd, repeated, again});
    }
    std::string text(TableFormat format, std::optional<int> marks = {}) const {
        return format_comparison(comparison_, format, marks);
    }
    Comparison comparison_;
};

TEST_F(Formats, Markdown) {
    const std::string markdown = text(TableFormat::kMarkdown, 3);
    EXPECT_NE(markdown.find("### x,\"y\" (set)\n\n"), std::string::npos) << markdown;
    EXPECT_NE(markdown.find("| a_b\\|c "), std::string::npos) << markdown;
    EXPECT_NE(markdown.find("&lt;b>&amp;"), std::string::npos) << markdown;
    EXPECT_NE(markdown.find(" **27.13** | "), std::string::npos) << markdown;
    EXPECT_NE(markdown.find(" **0.9123** | "), std::string::npos) << markdown;
    EXPECT_NE(markdown.find("<u>20.50</u> ± 0.71"), std::string::npos) << markdown;
    EXPECT_NE(markdown.find("| 20.00 (r0) "), std::string::npos) << markdown;
    EXPECT_NE(markdown.find("2 min 05 s |    1.50 GiB |"), std::string::npos) << markdown;
    EXPECT_NE(markdown.find("\n\nprotocol paper: ...\n"), std::string::npos) << markdown;
    EXPECT_EQ(markdown.find("ppisp"), std::string::npos) << "nothing was corrected\n" << markdown;
}

TEST_F(Formats, TerminalsShowTextAsItIs) {
    const std::string table = text(TableFormat::kTerminal, 3);
    for (const char* mark : {"**", "<u>", "\\|", "&lt;"}) EXPECT_EQ(table.find(mark), std::string::npos) << table;
    for (const char* part : {"| a_b|c ", "| <b>& ", " 27.13 |", " 20.50 ± 0.71 |"})
        EXPECT_NE(table.find(part), std::string::npos) << part << "\n" << table;
}

TEST_F(Formats, MarksAreThreeOnlyWhereManyCompare) {
    const auto marks = [](const std::string& table) {
        return std::vector<bool>{table.find("**") != std::string::npos, table.find("<u>") != std::string::npos,
                                 table.find(" *2") != std::string::npos};
    };
    EXPECT_EQ(marks(text(TableFormat::kMarkdown)), (std::vector{true, false, false})) << "two lines: the best";
    EXPECT_EQ(marks(text(TableFormat::kMarkdown, 0)), (std::vector{false, false, false}));
    EXPECT_EQ(marks(text(TableFormat::kMarkdown, 2)), (std::vector{true, true, false}));
    const Comparison four = compare_runs({run_of("a", "s", "m0", 24), run_of("b", "s", "m1", 23),
                                          run_of("c", "s", "m2", 22), run_of("d", "s", "m3", 21)});
    EXPECT_EQ(marks(format_comparison(four, TableFormat::kMarkdown)), (std::vector{true, true, true}));
    EXPECT_EQ(marks(format_comparison(four, TableFormat::kMarkdown, 1)), (std::vector{true, false, false}));
}

TEST_F(Formats, Csv) {
    const std::string csv = text(TableFormat::kCsv);
    EXPECT_TRUE(csv.starts_with(
        "run,dataset,scene,model,strategy,options,ppisp,runs,scenes,PSNR,PSNR_deviation,PSNR_worst,SSIM,"))
        << csv;
    EXPECT_NE(csv.find("\na_b|c,set,\"x,\"\"y\"\"\",50%,,,off,1,1,27.126,,,0.91234,,,"), std::string::npos) << csv;
    EXPECT_NE(csv.find(",2,1,20.5,0.7071067811865476,20,"), std::string::npos) << csv;
    EXPECT_EQ(std::count(csv.begin(), csv.end(), '\n'), 3);
}

TEST_F(Formats, Latex) {
    const std::string latex = text(TableFormat::kLatex, 3);
    for (const char* part :
         {"\\toprule", "\\midrule", "\\bottomrule", "a\\_b|c & 50\\% & - & - & \\textbf{27.13} & \\textbf{0.9123} ",
          "\\textless{}b\\textgreater{}\\&", "\\underline{20.50} $\\pm$ 0.71", "\\#Gs",
          "\\end{tabular}\n\\par\\smallskip\n{\\footnotesize protocol paper: ...\\par}", "& train time (min) &",
          "& peak memory (GiB)", "& 2.1 & 1.50"})
        EXPECT_NE(latex.find(part), std::string::npos) << part << "\n" << latex;
    EXPECT_EQ(latex.find("multicolumn"), std::string::npos) << "the protocol would widen the table";
}

TEST(Columns, UnitsFollowTheLargestValue) {
    const Column time{.key = "t", .title = "t", .units = {{"s", 1, 1}, {"min", 1 / 60.0, 1}, {"h", 1 / 3600.0, 2}}};
    EXPECT_EQ(column_unit(time, 0.1).name, "s");
    EXPECT_EQ(column_unit(time, 119).name, "s");
    EXPECT_EQ(column_unit(time, 120).name, "min");
    EXPECT_EQ(column_unit(time, 7200).name, "h");
}

TEST_F(Formats, Json) {
    const auto json = parse_json(text(TableFormat::kJson));
    EXPECT_EQ(json["protocol"], kLine);
    EXPECT_EQ(json["columns"][0], (nlohmann::json{{"key", "PSNR"}, {"title", "PSNR"}, {"better", "higher"}}));
    const auto& lines = json["tables"][0]["lines"];
    EXPECT_EQ(json["tables"][0]["scene"], "x,\"y\"");
    EXPECT_EQ(lines[0]["values"]["PSNR"], (nlohmann::json{{"mean", 27.126}, {"place", 1}}));
    EXPECT_TRUE(lines[0]["values"]["LPIPS-VGG"].is_null());
    EXPECT_EQ(lines[1]["values"]["PSNR"]["worst"], 20.0);
    EXPECT_EQ(lines[1]["runs"][1]["seed"], 1);
}

TEST_F(Formats, NamesThatAreNoUtf8OrHaveLineBreaksBreakNothing) {
    Comparison c = compare_runs({run_of("bad\xff\nname", "s", "m", 20)});
    EXPECT_NO_THROW(parse_json(format_comparison(c, TableFormat::kJson)));
    const std::string markdown = format_comparison(c, TableFormat::kMarkdown);
    EXPECT_EQ(std::count(markdown.begin(), markdown.end(), '\n'), 7);
    EXPECT_NE(format_comparison(c, TableFormat::kCsv).find("\"bad\xEF\xBF\xBD\nname\""), std::string::npos);
    c.tables[0].lines[0].values[0]->mean = std::numeric_limits<double>::infinity();
    EXPECT_TRUE(parse_json(format_comparison(c, TableFormat::kJson))["tables"][0]["lines"][0]["values"]["PSNR"]["mean"]
                    .is_null());
    EXPECT_EQ(html_escaped("<a href=\"x\">&'"), "&lt;a href=&quot;x&quot;&gt;&amp;&#39;");
}

TEST(TableFormats, AreNamed) {
    EXPECT_EQ(parse_table_format("json"), TableFormat::kJson);
    EXPECT_THROW(parse_table_format("html"), UsageError);
}

}  // namespace
}  // namespace gs
