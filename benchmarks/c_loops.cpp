// Times generated rigid-body dynamics and Pinocchio's in loops of compiled code, in turns.
//
// Arguments: shared library of the generated functions, number of rounds, calls in a sample. Standard input: numbers in
// text, see main. Standard output: one line of each function, with its name, the largest relative difference of its results
// to the generated ones, and the seconds a call of each round.
#include <dlfcn.h>
#include <time.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <functional>
#include <iostream>
#include <string>
#include <vector>

#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/multibody.hpp>

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::VectorXd;
using Generated = void (*)(const double *, const double *, const double *, const double *, const double *, double *);

struct State {
    VectorXd q, q_dot, last;  // accelerations, or torques
};

static double number()
{
    double value;
    if (!(std::cin >> value)) {
        std::fprintf(stderr, "the input ends too early\n");
        std::exit(2);
    }
    return value;
}

template <class Matrix> static Matrix numbers(long rows, long columns)
{
    Matrix m(rows, columns);
    for (long i = 0; i < rows; i++)
        for (long j = 0; j < columns; j++)
            m(i, j) = number();
    return m;
}

// Gravity, then of each joint: whether it is prismatic, rotation row by row, offset, mass, centroid, inertia row by row.
static pinocchio::Model read_model(int n)
{
    pinocchio::Model model;
    model.gravity.linear(-numbers<Vector3d>(3, 1));
    pinocchio::JointIndex joint = 0;
    for (int i = 0; i < n; i++) {
        const bool prismatic = number() != 0.0;
        const Matrix3d rotation = numbers<Matrix3d>(3, 3);
        const Vector3d offset = numbers<Vector3d>(3, 1);
        const double mass = number();
        const Vector3d centroid = numbers<Vector3d>(3, 1);
        const Matrix3d inertia = numbers<Matrix3d>(3, 3);
        const pinocchio::SE3 placement(rotation, offset);
        const std::string name = "joint_" + std::to_string(i + 1);
        joint = prismatic ? model.addJoint(joint, pinocchio::JointModelPZ(), placement, name)
                          : model.addJoint(joint, pinocchio::JointModelRZ(), placement, name);
        model.appendBodyToJoint(joint, pinocchio::Inertia(mass, centroid, inertia), pinocchio::SE3::Identity());
    }
    return model;
}

struct Case {
    const char *name;
    std::function<VectorXd(const State &)> result;
    std::function<double()> seconds_a_call;
    std::vector<double> times;
};

// Wall time would make a function whose sample is as long as a time slice of the system look slow on a busy machine.
static double processor_time()
{
    timespec t;
    clock_gettime(CLOCK_PROCESS_CPUTIME_ID, &t);
    return double(t.tv_sec) + 1e-9 * double(t.tv_nsec);
}

// The call is inlined into the loop; only the loop as a whole is called through a pointer.
template <class Call>
static Case make_case(const char *name, const Call &call, const std::vector<State> &states, long calls)
{
    const auto loop = [call, &states, calls]() {
        const double began = processor_time();
        std::size_t k = 0;
        for (long i = 0; i < calls; i++) {
            call(states[k]);
            k = k + 1 == states.size() ? 0 : k + 1;
        }
        return (processor_time() - began) / double(calls);
    };
    return {name, [call](const State &s) { return VectorXd(call(s)); }, loop, {}};
}

int main(int argc, char **argv)
{
    void *library = argc == 4 ? dlopen(argv[1], RTLD_NOW) : nullptr;
    if (!library) {
        std::fprintf(stderr, "%s\n", argc == 4 ? dlerror() : "expected: library, rounds, calls");
        return 2;
    }
    const auto inverse = reinterpret_cast<Generated>(dlsym(library, "inverse_dynamics"));
    const auto forward = reinterpret_cast<Generated>(dlsym(library, "forward_dynamics"));
    const int rounds = std::atoi(argv[2]);
    const long calls = std::atol(argv[3]);

    // joints, model, parameters of the generated functions, states
    const int n = int(number());
    const pinocchio::Model model = read_model(n);
    const VectorXd p = numbers<VectorXd>(long(number()), 1);
    std::vector<State> states(static_cast<std::size_t>(number()));
    for (State &state : states)
        for (VectorXd *values : {&state.q, &state.q_dot, &state.last})
            *values = numbers<VectorXd>(n, 1);

    pinocchio::Data data[] = {pinocchio::Data(model), pinocchio::Data(model), pinocchio::Data(model)};
    const VectorXd F_e = VectorXd::Zero(6);
    VectorXd result(n);
    const auto generated = [&](Generated function) {
        return [&F_e, &p, &result, function](const State &s) -> const VectorXd & {
            function(s.q.data(), s.q_dot.data(), s.last.data(), F_e.data(), p.data(), result.data());
            return result;
        };
    };
    const auto rnea = [&](const State &s) -> const VectorXd & {
        return pinocchio::rnea(model, data[0], s.q, s.q_dot, s.last);
    };
    const auto aba = [&](pinocchio::Convention convention, pinocchio::Data &own) {
        return [&model, &own, convention](const State &s) -> const VectorXd & {
            return pinocchio::aba(model, own, s.q, s.q_dot, s.last, convention);
        };
    };
    std::vector<Case> cases = {
        make_case("inverse_dynamics", generated(inverse), states, calls),
        make_case("rnea", rnea, states, calls),
        make_case("forward_dynamics", generated(forward), states, calls),
        make_case("aba_local", aba(pinocchio::Convention::LOCAL, data[1]), states, calls),
        make_case("aba_world", aba(pinocchio::Convention::WORLD, data[2]), states, calls),
    };
    for (int k = 0; k < rounds; k++)
        for (Case &c : cases)
            c.times.push_back(c.seconds_a_call());

    const std::size_t reference[] = {0, 0, 2, 2, 2};
    for (std::size_t i = 0; i < cases.size(); i++) {
        double difference = 0.0;
        for (const State &state : states) {
            const VectorXd expected = cases[reference[i]].result(state), found = cases[i].result(state);
            difference = std::max(difference, (found - expected).cwiseAbs().maxCoeff() / expected.cwiseAbs().maxCoeff());
        }
        std::printf("%s %.6e", cases[i].name, difference);
        for (double time : cases[i].times)
            std::printf(" %.6e", time);
        std::printf("\n");
    }
    return 0;
}
