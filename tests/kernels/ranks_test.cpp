// SPDX-License-Identifier: Apache-2.0
// A model that several ranks train together does what it does on one. Knows no appearance by name, so that it runs on
// any registry.
#include <gtest/gtest.h>

#include <algorithm>
#include <numeric>

#include "appearance/model_info.h"
#include "kernels/base/error.h"
#include "kernels/ranks/message.h"
#include "tests/kernels/backends.h"
#include "tests/kernels/rank_threads.h"
#include "tests/kernels/rank_views.h"
#include "tests/kernels/ranks_on.h"

namespace gs::test {
namespace {

struct TheCpu {
    static constexpr double kPicture = 0, kSums = 1e-5;  // pictures are those of one rank to the bit
    static std::unique_ptr<Engine> make_engine(const AppearanceSpec& appearance, bool) {
        return make_cpu_engine(appearance);
    }
    static void skip() {}
};
INSTANTIATE_TYPED_TEST_SUITE_P(Cpu, RanksOn, TheCpu);

class EveryModelOnRanks : public ::testing::TestWithParam<std::string> {
  protected:
    const ModelInfo& info = appearance_model(GetParam());
};

TEST_P(EveryModelOnRanks, TakeTheMeanGradientOfTheViews) {
    const RankViews views(info);
    auto plain = views.steps();
    for (StepRequest& step : plain) step.loss.opacity_reg = step.loss.scale_reg = 0;
    Gaussians sum = sum_of_steps(views.model, plain);
    for (const int ranks : {1, 2, 3, 4}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        Gaussians after;
        with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(), [&](Backend& backend) {
            backend.upload(views.model);
            auto steps = views.steps();
            for (StepRequest& step : steps) {
                step.loss.opacity_reg = step.loss.scale_reg = 0;
                if (&step != &steps[0]) step.target.f32 = nullptr;  // the other ranks bring it themselves
            }
            if (ranks < kViews)  // rank 0 renders more views than the first
                for (std::size_t k = 0; k < kViews; k += std::size_t(ranks)) steps[k] = views.step(k);
            for (StepRequest& step : steps) step.loss.opacity_reg = step.loss.scale_reg = 0;
            backend.step_on(steps);
            backend.synchronize();
            const StepStats stats = backend.take_stats();
            EXPECT_EQ(stats.steps, 1);
            EXPECT_EQ(stats.num_nonfinite_gradients, 0);
            after = backend.download(true);
        });
        EXPECT_EQ(after.step, kViews);
        for_arrays(sum, after, [&](const auto& x, const auto& y, const std::string& what) {
            if (what.find("first") == std::string::npos) return;
            std::vector<float> a = x, b = y;
            // The regulariser of PPISP is in every step, and so has the same mean.
            for (float& value : a) value *= mean_of_moments(kViews);
            for (float& value : b) value *= gradient_of_moment(kViews);
            expect_close(a, b, 1e-5, what);
        });
    }
}

TEST_P(EveryModelOnRanks, TrainAsOne) {
    for (const RankViews& views :
         {RankViews(info), RankViews(info, kRows, 60), RankViews(info, kRows, 60).through_lenses()}) {
        Gaussians one;
        for (const int ranks : {1, 2, 3, 4}) {
            SCOPED_TRACE(std::to_string(ranks) + " ranks, " + views.name());
            with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(), [&](Backend& backend) {
                backend.upload(views.model);
                for (int k = 0; k < 3; ++k) {
                    auto steps = views.steps();
                    steps[0].gather_gradient_stats = true;
                    backend.step_on(steps);
                }
                Gaussians after = backend.download(true);
                if (ranks == 1) {
                    one = after;
                    return;
                }
                for_arrays(one, after, [](const auto& x, const auto& y, const std::string& what) {
                    if (what == "PPISP") return;  // steps of the usual length along gradients that are but rounding
                    expect_close(x, y, what.find("moment") == std::string::npos ? 1e-4 : 1e-3, what);
                });
            });
        }
    }
}

INSTANTIATE_TEST_SUITE_P(Models, EveryModelOnRanks, ::testing::ValuesIn([] {
                             std::vector<std::string> names;
                             for (const ModelInfo* info : appearance_models()) names.push_back(info->name);
                             return names;
                         }()),
                         [](const auto& info) {
                             std::string name = info.param;
                             std::replace_if(
                                 name.begin(), name.end(), [](char c) { return !std::isalnum(c); }, '_');
                             return name;
                         });

TEST(RankMessages, BringAllOfAStepThatIsNotInTheMemoryOfRank0) {
    StepRequest sent;
    sent.camera.width = 7, sent.background = {0.1f, 0.2f, 0.3f};
    sent.target.width = 8, sent.target.height = 9, sent.target.channels = 4, sent.target.id = {3, 2};
    sent.isp = {IspMode::kController, 5, 1, 0.5f}, sent.iteration = 11, sent.seed = 12;
    sent.loss = {0.4f, 0.5f, 0.6f};
    sent.rates.residuals = {1, 2}, sent.rates.shared = 3, sent.rates.isp = 4, sent.rates.noise = 5;
    for (int g = 0; g < kNumGroups; ++g) sent.rates.groups[g] = 6 + g;
    sent.rates.center = {13, 14, 15}, sent.rates.extent = 16, sent.rates.far = 17;
    sent.gather_gradient_stats = sent.only_visible = true;
    MessageWriter writer;
    put(writer, std::vector{sent});
    const auto bytes = writer.bytes();
    MessageReader reader(std::vector<std::byte>(bytes.begin(), bytes.end()));
    std::vector<StepRequest> received;
    get(reader, received);
    ASSERT_EQ(received.size(), 1u);
    const StepRequest& r = received[0];
    EXPECT_EQ(r.camera.width, 7);
    EXPECT_EQ(r.background.z, 0.3f);
    EXPECT_TRUE(r.target.width == 8 && r.target.height == 9 && r.target.channels == 4);
    EXPECT_EQ(r.target.id, sent.target.id);
    EXPECT_TRUE(r.isp.mode == IspMode::kController && r.isp.frame == 5 && r.isp.camera == 1);
    EXPECT_EQ(r.isp.prior_exposure, 0.5f);
    EXPECT_TRUE(r.iteration == 11 && r.seed == 12);
    EXPECT_TRUE(r.loss.lambda_dssim == 0.4f && r.loss.opacity_reg == 0.5f && r.loss.scale_reg == 0.6f);
    EXPECT_EQ(r.rates.residuals, sent.rates.residuals);
    EXPECT_TRUE(std::ranges::equal(r.rates.groups, sent.rates.groups));
    EXPECT_TRUE(r.rates.shared == 3 && r.rates.isp == 4 && r.rates.noise == 5);
    EXPECT_TRUE(r.rates.center.z == 15 && r.rates.extent == 16 && r.rates.far == 17);
    EXPECT_TRUE(r.gather_gradient_stats && r.only_visible);
}

TEST(Ranks, RenderWithTheControllersThatWereTrained) {
    RankViews views(some_model());
    initialize_controller(views.model.ppisp, 1);
    std::vector<RenderRequest> requests(2);  // the same for both ranks
    for (RenderRequest& request : requests) {
        request.camera = views.cameras[0];
        request.isp = {IspMode::kController, -1, 0, 0};
    }
    with_ranked_backend(2, 1, views.model.appearance, views.targets(), [&](Backend& backend) {
        backend.upload(views.model);
        std::vector<RenderedImage> before, after;
        backend.render_all(requests, before);
        StepRequest step = views.step(0);
        step.isp = requests[0].isp, step.rates.isp = 1e-2;
        for (int k = 0; k < 3; ++k) backend.distill(step);
        backend.render_all(requests, after);
        EXPECT_NE(before[0].rgb, after[0].rgb);
        EXPECT_EQ(after[0].rgb, after[1].rgb);
    });
}

TEST(Ranks, RenderManyViewsAsOneDoesToTheBit) {
    RankViews views(some_model(), kRows, 90);
    // Rows at the same place have the same depth, so that their order decides.
    auto& means = views.model[Group::kMean].param;
    for (std::int64_t i = 0; i < kRows; ++i) std::copy_n(&means[3 * (i % 7)], 3, &means[3 * i]);
    std::vector<RenderRequest> requests(7);
    for (std::size_t k = 0; k < requests.size(); ++k) {
        requests[k].camera = views.cameras[k % kViews];
        requests[k].mode = RenderMode(k % 3);
        requests[k].background = {0.1f * float(k), 0.5f, 0};
    }
    const auto plain = make_cpu_backend(views.model.appearance);
    plain->upload(views.model);
    std::vector<RenderedImage> expected;
    plain->render_all(requests, expected);
    for (const int ranks : {1, 2, 3, 8}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, 1, views.model.appearance, views.targets(), [&](Backend& backend) {
            EXPECT_EQ(backend.views_at_once(), ranks);
            backend.upload(views.model);
            std::vector<RenderedImage> found;
            backend.render_all(requests, found);
            ASSERT_EQ(found.size(), expected.size());
            for (std::size_t k = 0; k < found.size(); ++k) {
                EXPECT_EQ(found[k].width, kRankWidth) << k;
                EXPECT_EQ(found[k].height, kRankHeight) << k;
                EXPECT_EQ(found[k].rgb, expected[k].rgb) << k;
                EXPECT_EQ(found[k].alpha, expected[k].alpha) << k;
            }
        });
    }
}

/// The bytes that each rank sends in steps on all views, as the formats of the messages say.
std::vector<double> expected_bytes_sent(const RankViews& views, int ranks) {
    constexpr std::size_t kSplat = 48, kSums = 36, kLength = 8, kCall = 4, kCount = 8, kReport = 48, kFloat = 4;
    std::vector<std::vector<std::size_t>> shown;  // splats by rank, by view
    for (int r = 0; r < ranks; ++r) {
        const auto engine = make_cpu_engine(views.model.appearance);
        engine->upload(dealt_part(views.model, ranks, r));
        shown.emplace_back();
        for (const auto& camera : views.cameras) {
            ProjectedView projected;
            engine->begin_projection(camera, RenderMode::kFull, true);
            engine->end_projection(projected, {}, nullptr);
            shown.back().push_back(projected.splats.size());
        }
    }
    MessageWriter steps;
    put(steps, views.steps());
    std::vector<double> sent;
    for (int r = 0; r < ranks; ++r) {
        std::size_t bytes = 0;
        for (int view = 0; view < kViews; ++view)
            for (int other = 0; other < ranks; ++other) {
                if (other == r) continue;
                if (view % ranks == other) bytes += kCount + kSplat * shown[std::size_t(r)][std::size_t(view)];
                if (view % ranks == r) bytes += kSums * shown[std::size_t(other)][std::size_t(view)];
            }
        std::size_t each = kReport * kViews + kFloat * views.model.ppisp.size();  // to each other rank
        if (r == 0) each += std::max(kFirstPacketBytes, kLength + kCall + steps.bytes().size());
        sent.push_back(double(bytes + std::size_t(ranks - 1) * each));
    }
    return sent;
}

TEST(Ranks, ExchangeWhatTheFormatsOfTheMessagesSay) {
    constexpr int kSteps = 3;
    for (const std::int64_t rows : {std::int64_t(0), std::int64_t(2), kRows}) {
        const RankViews views(some_model(), rows);
        for (const int ranks : {1, 2, 3}) {
            SCOPED_TRACE(std::to_string(rows) + " rows, " + std::to_string(ranks) + " ranks");
            const std::vector<double> expected = expected_bytes_sent(views, ranks);
            with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(), [&](Backend& backend) {
                std::vector<StepRequest> steps = views.steps();
                for (StepRequest& step : steps)  // what is shown stays what it is
                    std::fill_n(step.rates.groups, kNumGroups, 0.0), step.rates.isp = 1e-9;
                backend.upload(views.model);
                backend.step_on(steps);
                backend.take_reports();  // what came before does not count
                for (int k = 0; k < kSteps; ++k) backend.step_on(steps);
                const std::vector<RankReport> reports = backend.take_reports();
                ASSERT_EQ(reports.size(), std::size_t(ranks));
                double sent = 0, received = 0;
                std::int64_t held = 0;
                for (std::size_t r = 0; r < reports.size(); ++r) {
                    const RankCosts& costs = reports[r].costs;
                    EXPECT_EQ(costs.steps, kSteps);
                    EXPECT_EQ(costs.traffic.sent, kSteps * expected[r]) << r;
                    EXPECT_GT(costs.seconds, 0);
                    EXPECT_GT(costs.cpu_seconds, 0);
                    EXPECT_LE(costs.traffic.seconds, costs.seconds);
                    EXPECT_GT(reports[r].resident_bytes, 1 << 20);
                    sent += costs.traffic.sent, received += costs.traffic.received;
                    held += reports[r].rows;
                }
                EXPECT_EQ(sent, received);
                EXPECT_EQ(held, rows);
                const LinkSpeed link = backend.measure_connection();
                EXPECT_EQ(link.bytes_per_second > 0, ranks > 1);
                EXPECT_EQ(link.latency_seconds > 0, ranks > 1);
            });
        }
    }
}

TEST(Ranks, AskForEachImageOnce) {
    const RankViews views(some_model(), kRows, 90);
    const auto plain = make_cpu_backend(views.model.appearance);
    plain->upload(views.model);
    const ResidualScores expected = plain->residual_scores(kViews, [&](std::size_t view) { return views.step(view); });
    for (const int ranks : {1, 2, 3}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, kViews, views.model.appearance, views.targets(), [&](Backend& backend) {
            backend.upload(views.model);
            std::vector<int> asked(kViews, 0);
            std::vector<float> pixels;  // of the last view alone
            const ResidualScores found = backend.residual_scores(kViews, [&](std::size_t view) {
                ++asked[view];
                StepRequest step = views.step(view);
                pixels = views.photographs[view];
                step.target.f32 = pixels.data();
                return step;
            });
            EXPECT_EQ(asked, std::vector<int>(kViews, 1));
            expect_close(expected.worth, found.worth, 1e-4, "worth of residuals");
        });
    }
}

TEST(Ranks, RemoveTheRowsThatOneWouldRemove) {
    RankViews views(some_model(), kRows, 90);
    for (std::int64_t i = 0; i < kRows; i += 9) views.model[Group::kOpacity].param[i] = -20;
    views.model[Group::kMean].param[3 * 7] = std::nanf("");
    std::vector<RenderRequest> requests(kViews);
    for (std::size_t k = 0; k < kViews; ++k) requests[k].camera = views.cameras[k];
    std::vector<std::uint8_t> marks(kRows, 0);
    for (std::int64_t i = 0; i < kRows; i += 2) marks[i] = 1;
    const auto remove = [&](Backend& backend) {
        backend.upload(views.model);
        backend.keep_residuals(marks, views.model[Group::kBase].param);
        const PruneStats broken = backend.prune_nonfinite();
        EXPECT_EQ(broken.removed, 1);
        EXPECT_EQ(broken.by_group[0], 1);
        EXPECT_GT(backend.prune_invisible(), kRows / 10);
        const std::int64_t before = backend.count();
        const std::int64_t lowest = backend.prune_lowest_scores(requests, 0.4);
        EXPECT_EQ(backend.count(), before - lowest);
        backend.set_active_degree(0);
        backend.densify({OpacityReset{}, 0, 0});
        Gaussians after = backend.download(true);
        // Ranks lose different numbers of rows, which changes their order but not which there are.
        std::vector<float> places;
        for (std::int64_t i = 0; i < after.count; ++i) places.push_back(after[Group::kMean].param[3 * i]);
        std::sort(places.begin(), places.end());
        return std::pair(places, after.num_residuals());
    };
    const auto plain = make_cpu_backend(views.model.appearance);
    const auto expected = remove(*plain);
    EXPECT_GT(expected.second, 0);
    for (const int ranks : {1, 2, 3})
        with_ranked_backend(ranks, 1, views.model.appearance, views.targets(),
                            [&](Backend& backend) { EXPECT_EQ(remove(backend), expected) << ranks; });
}

TEST(Ranks, CloneAndSplitUpToTheCap) {
    RankViews views(some_model(), kRows, 90);
    views.model.gradient_sum.assign(kRows, 1.0f), views.model.gradient_count.assign(kRows, 1.0f);
    for (const int ranks : {1, 2, 4}) {
        SCOPED_TRACE(std::to_string(ranks) + " ranks");
        with_ranked_backend(ranks, 1, views.model.appearance, views.targets(), [&](Backend& backend) {
            backend.upload(views.model);
            AdcParams adc;
            adc.cap = kRows + 50;
            adc.min_opacity = 1e-6f;
            const DensifyStats stats = backend.densify({adc, 1, 42});
            EXPECT_EQ(stats.cloned + stats.split, 50);
            EXPECT_EQ(backend.count(), kRows + 50 - stats.pruned);
            adc.min_opacity = 0.9999f;
            EXPECT_THROW(backend.densify({adc, 2, 42}), UsageError);
        });
    }
}

}  // namespace
}  // namespace gs::test
