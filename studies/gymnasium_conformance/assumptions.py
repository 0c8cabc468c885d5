"""What some of Gymnasium's tests assume of the environment that a cradle replaces."""

_DISCRETE = "steps with the number of a discrete action; a cradle's are arrays, and it refuses others"
_GRAVITY = "asks for CartPole's attribute `gravity`; a cradle's is a setting"
_LENGTHS = "expects files named after the episodes of CartPole, which last some 20 steps; a cradle's last longer"

#: Why a test cannot hold of a cradle, by the beginning of its name.
ASSUMED: dict[str, str] = {
    "tests/envs/test_action_dim_check.py::test_box_actions_out_of_bound[NewtonCradleRelease-v0]": (
        "steps twice after one reset; an episode of this one is a single step"
    ),
    "tests/envs/test_rendering.py::test_pygame_selective_init": (
        "expects pictures to open pygame's display; a cradle draws its pictures without one"
    ),
    "tests/vector/test_async_vector_env.py::test_reset_async_vector_env": (
        "expects the empty infos of CartPole; a cradle's hold the energy ledger"
    ),
    "tests/vector/test_async_vector_env.py::test_step_async_vector_env": _DISCRETE,
    "tests/vector/test_async_vector_env.py::test_call_async_vector_env": _GRAVITY,
    "tests/vector/test_sync_vector_env.py::test_call_sync_vector_env": _GRAVITY,
    "tests/vector/test_vector_wrapper.py::test_vector_env_wrapper_attributes": _GRAVITY,
    "tests/wrappers/test_action_repeat.py::test_action_repeat_reward_accumulation": _DISCRETE,
    "tests/wrappers/test_clip_reward.py::test_clip_reward_wrapper": _DISCRETE,
    "tests/wrappers/test_frame_stack_observation.py::test_padding_type": "pads with observations of CartPole's shape",
    "tests/wrappers/test_record_video.py::test_video_folder_and_filenames": _LENGTHS,
    "tests/wrappers/test_record_video.py::test_both_episodic_and_step_trigger": _LENGTHS,
    "tests/wrappers/vector/test_record_video.py::test_both_episodic_and_step_trigger": _LENGTHS,
    "tests/wrappers/vector/test_record_video.py::test_video_folder_and_filenames": _LENGTHS,
    "tests/wrappers/vector/test_vector_wrappers.py::test_vector_wrapper_equivalence[CartPole-v1-RescaleObservation": (
        "gives bounds of CartPole's four observations"
    ),
    "tests/wrappers/vector/test_vectorize_transform.py::test_vectorize_dict_to_box_obs": (
        "writes the observation beside the first of CartPole's four"
    ),
    "tests/wrappers/vector/test_human_rendering.py::test_render_modes": (
        "expects the wrapper to refuse a render mode that CartPole takes; a cradle refuses it itself"
    ),
}
